"""Where the base has been and where it bumped, kept relative to keyframes: both move when the map is adjusted."""

import math
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3

TRAIL_STEP_M = 0.05
BUMP_STEP_M, BUMP_STEP_RAD = 0.1, 0.5
_LOOSE = -1


class AnchoredPoses:
    """Poses on the floor, each tied to a keyframe; one whose keyframe is gone is tied anew where it stood last."""

    def __init__(self, spacing_m: float, spacing_rad: float = math.inf) -> None:
        """A pose is left out that is nearer than this to the one before, in place [m] and heading [rad]."""
        self._spacing_m, self._spacing_rad = spacing_m, spacing_rad
        self._world, self._relative = np.zeros((0, 3)), np.zeros((0, 3))
        self._anchor = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self._world)

    def add(self, pose: SE2) -> None:
        """A pose in the map as it is now; it is tied at the next ``poses``."""
        if len(self._world):
            last = SE2(*self._world[-1].tolist())
            if last.distance_to(pose) <= self._spacing_m and abs(last.angle_to(pose)) <= self._spacing_rad:
                return
        self._world = np.vstack([self._world, pose.as_array()])
        self._relative = np.vstack([self._relative, np.zeros(3)])
        self._anchor = np.append(self._anchor, _LOOSE)

    def last_poses(self) -> list[SE2]:
        """Where they were in the map that ``poses`` was last asked for."""
        return [SE2(*row) for row in self._world.tolist()]

    def keep(self, which: Sequence[bool]) -> None:
        """Forget all but these of the ``last_poses``."""
        chosen = np.asarray(which, bool)
        self._world, self._relative, self._anchor = self._world[chosen], self._relative[chosen], self._anchor[chosen]

    def state(self) -> FloatArray:
        """(N, 7) all of it, for ``restore``: pose in the world and relative to its keyframe, id of the keyframe."""
        return np.hstack([self._world, self._relative, self._anchor[:, None]])

    def restore(self, state: FloatArray) -> None:
        """Go on from what ``state`` gave. Raises InputError for anything else."""
        if state.ndim != 2 or state.shape[1] != 7 or not np.isfinite(state).all():
            raise InputError(f"poses to go on with must be finite, of shape (N, 7), not {state.shape}; start a new run")
        self._world, self._relative = state[:, :3].astype(float), state[:, 3:6].astype(float)
        self._anchor = state[:, 6].astype(np.int64)

    def poses(self, keyframe_ids: IntArray, T_world_cams: Sequence[SE3]) -> list[SE2]:
        """Where they are in a map of these keyframes (K,), ids ascending."""
        if len(keyframe_ids) and len(self._world):
            self._move(np.asarray(keyframe_ids, np.int64), _headings(T_world_cams))
        return self.last_poses()

    def _move(self, ids: IntArray, cameras: FloatArray) -> None:
        at = np.minimum(np.searchsorted(ids, self._anchor), len(ids) - 1)
        tied = ids[at] == self._anchor
        self._world[tied] = _composed(cameras[at[tied]], self._relative[tied])
        loose = np.flatnonzero(~tied)
        away = np.linalg.norm(self._world[loose, None, :2] - cameras[None, :, :2], axis=2)
        nearest = away.argmin(axis=1)
        self._anchor[loose] = ids[nearest]
        self._relative[loose] = _relative(cameras[nearest], self._world[loose])


def _headings(T_world_cams: Sequence[SE3]) -> FloatArray:
    """(K, 3) x, y [m] and heading of the optical axis [rad] of each camera."""
    axes = np.array([T.rotation[:2, 2] for T in T_world_cams])
    positions = np.array([T.translation[:2] for T in T_world_cams])
    return np.column_stack([positions, np.arctan2(axes[:, 1], axes[:, 0])])


def _composed(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, 3) poses a_i @ b_i of (N, 3) and (N, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    x, y = c * b[:, 0] - s * b[:, 1], s * b[:, 0] + c * b[:, 1]
    return np.column_stack([a[:, 0] + x, a[:, 1] + y, a[:, 2] + b[:, 2]])


def _relative(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, 3) poses a_i.inverse() @ b_i of (N, 3) and (N, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    x, y = (b[:, :2] - a[:, :2]).T
    return np.column_stack([c * x + s * y, -s * x + c * y, b[:, 2] - a[:, 2]])
