"""Poses of the base, such as its trail and its bumps, that are stored relative to keyframes and move when the map is
adjusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.occupancy.grid import MAX_EXTENT_M

TRAIL_STEP_M = 0.05  # a cell of the map: a finer trail shows no more
BUMP_STEP_M, BUMP_STEP_RAD = 0.1, 0.5  # closer bumps count as one
_WHOLE, _THINNED_M = 4000, 0.1
"""So many of the newest poses are kept as they came, 200 m of trail. Of older ones, the first at each place of this
size is kept, with the time of the last pass: the body is wider, and a trail that is driven again and again must not
grow."""
_MOVED_M, _MOVED_RAD = 0.05, 0.03  # keyframes that moved less: no correction
_AT_ONCE = 1000  # poses whose distances to all keyframes are computed together
NEAREST = -1  # keyframe to tie a pose to; others to be tied to are stored as NEAREST - 1 - id


class AnchoredPoses:
    """Poses on the floor, each tied to a keyframe. If that is removed, the pose is tied to the one that was nearest.
    added: how many were ever added. newest (N,): id of the newest keyframe when the base was last at each pose; NEAREST
    until the next ``poses``."""

    def __init__(self, spacing_m: float, spacing_rad: float = math.inf) -> None:
        """A pose closer than this to the one before, in both position [m] and heading [rad], is left out."""
        self._spacing_m, self._spacing_rad, self.added = spacing_m, spacing_rad, 0
        self._world, self._relative = np.zeros((0, 3)), np.zeros((0, 3))
        self._anchor, self.newest = np.zeros(0, np.int64), np.zeros(0, np.int64)
        # The keyframes' ids and headings in the last call of ``poses``.
        self._last: tuple[IntArray, FloatArray] = np.zeros(0, np.int64), np.zeros((0, 3))

    def __len__(self) -> int:
        return len(self._world)

    def add(self, pose: SE2, beside: int = NEAREST) -> None:
        """Add a pose in the current map; the next ``poses`` ties it to a keyframe. beside: id of that by which the pose
        was found. Where a loop is about to be closed, the nearest one may be of the other part of the map."""
        if len(self._world):
            last = SE2(*self._world[-1].tolist())
            if last.distance_to(pose) <= self._spacing_m and abs(last.angle_to(pose)) <= self._spacing_rad:
                self.newest[-1] = NEAREST
                return
        self._world = np.vstack([self._world, pose.as_array()])
        self._relative = np.vstack([self._relative, np.zeros(3)])
        self._anchor = np.append(self._anchor, NEAREST - 1 - beside)
        self.newest = np.append(self.newest, NEAREST)
        self.added += 1
        if (old := len(self._world) - 1 - _WHOLE) >= 0 and math.isinf(self._spacing_rad):  # else headings count
            self._thin(old)

    def _thin(self, old: int) -> None:
        """Leave this pose out if an older one is beside it; the nearest of those takes over when the base was there.
        One that is newer is no reason: it may be left out itself, for the next one."""
        away = np.linalg.norm(self._world[:old, :2] - self._world[old, :2], axis=1)
        if (away < _THINNED_M).any():
            times = self.newest[[near := int(away.argmin()), old]]
            self.newest[near] = NEAREST if (times == NEAREST).any() else times.max()
            self.keep(np.arange(len(self)) != old)

    def last_poses(self) -> list[SE2]:
        """The poses in the map of the last call of ``poses``."""
        return [SE2(*row) for row in self._world.tolist()]

    def keep(self, which: Sequence[bool] | BoolArray) -> None:
        """Keep only these of the ``last_poses``."""
        chosen = np.asarray(which, bool)
        self._world, self._relative, self._anchor = self._world[chosen], self._relative[chosen], self._anchor[chosen]
        self.newest = self.newest[chosen]

    def state(self) -> FloatArray:
        """(N, 8) for ``restore``: pose in the world, pose relative to its keyframe, id of the keyframe, ``newest``."""
        return np.column_stack([self._world, self._relative, self._anchor, self.newest])

    def restore(self, state: FloatArray) -> None:
        """Continue from a ``state``; those of older versions were (N, 7). Raises InputError for anything else."""
        if state.ndim != 2 or state.shape[1] not in (7, 8) or not (np.abs(state) <= MAX_EXTENT_M).all():
            raise InputError(
                f"poses to go on with must be of shape (N, 8), not {state.shape}, within {MAX_EXTENT_M:g} m; "
                "start a new run"
            )
        self._world, self._relative = state[:, :3].astype(float), state[:, 3:6].astype(float)
        self._anchor, self.added = state[:, 6].astype(np.int64), len(state)
        self.newest = state[:, 7].astype(np.int64) if state.shape[1] == 8 else np.full(len(state), NEAREST)

    def settle(self) -> None:
        """Tie poses that are tied to no keyframe yet to those of the last ``poses``: they are in that map, and the next
        one is corrected."""
        if len(self._last[0]):
            self._tie(self._anchor < 0, *self._last)

    def poses(self, keyframe_ids: IntArray, T_world_cams: Sequence[SE3]) -> list[SE2]:
        """The poses in a map of these keyframes (K,), ids ascending."""
        if len(keyframe_ids):
            self._move(np.asarray(keyframe_ids, np.int64), _headings(T_world_cams))
        return self.last_poses()

    def _move(self, ids: IntArray, cameras: FloatArray) -> None:
        # A keyframe is often removed when a loop is closed: the map that the pose was in is the one before.
        before, there = self._last
        lasting = np.isin(before, ids)
        if lasting.any():
            self._tie((self._anchor >= 0) & ~np.isin(self._anchor, ids), before[lasting], there[lasting])
        at = np.minimum(np.searchsorted(ids, self._anchor), len(ids) - 1)
        tied = ids[at] == self._anchor
        self._world[tied] = _composed(cameras[at[tied]], self._relative[tied])
        self._tie(~tied, ids, cameras)
        self.newest[self.newest == NEAREST] = ids[-1]
        self._last = ids, cameras

    def _tie(self, which: BoolArray, ids: IntArray, cameras: FloatArray) -> None:
        """Tie these poses to the keyframe beside which they were added, else to the nearest one."""
        loose = np.flatnonzero(which)
        away = np.linalg.norm(self._world[loose, None, :2] - cameras[None, :, :2], axis=2)
        beside = NEAREST - 1 - self._anchor[loose]
        at = np.minimum(np.searchsorted(ids, beside), len(ids) - 1)
        chosen = np.where(ids[at] == beside, at, away.argmin(axis=1))
        self._anchor[loose] = ids[chosen]
        self._relative[loose] = _relative(cameras[chosen], self._world[loose])


def _headings(T_world_cams: Sequence[SE3]) -> FloatArray:
    """(K, 3) x, y [m] and heading of the optical axis [rad] of each camera."""
    R, t = stacked(T_world_cams)
    return np.column_stack([t[:, :2], np.arctan2(R[:, 1, 2], R[:, 0, 2])])


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


class KeyframePlaces(NamedTuple):
    """ids (K,), ascending, of keyframes, and poses (K, 3): x, y [m] and heading of the optical axis [rad] of each."""

    ids: IntArray
    poses: FloatArray

    @staticmethod
    def of(ids: IntArray, T_world_cams: Sequence[SE3]) -> KeyframePlaces:
        """The places of these keyframes."""
        return KeyframePlaces(np.asarray(ids, np.int64), _headings(T_world_cams) if len(ids) else np.zeros((0, 3)))

    def known_in(self, other: KeyframePlaces) -> tuple[FloatArray, FloatArray]:
        """(N, 3) poses of the keyframes that are in both, here and in the other."""
        _, here, there = np.intersect1d(self.ids, other.ids, assume_unique=True, return_indices=True)
        return self.poses[here], other.poses[there]


class MapCorrections:
    """Tells how the map has moved, for poses that are kept elsewhere. Call ``update`` with the keyframes of each map,
    and move all kept poses with ``moved`` when it was corrected."""

    def __init__(self) -> None:
        self._told: KeyframePlaces | None = None
        self._last: KeyframePlaces | None = None
        self._before, self._now = np.zeros((0, 3)), np.zeros((0, 3))

    def update(self, now: KeyframePlaces) -> bool:
        """Whether keyframes have moved since the last correction, or since they were made."""
        if now is self._told:
            return False
        self._told = now
        last, self._last = self._last or now, now
        self._before, self._now = before, there = last.known_in(now)
        x, y, turn = _relative(before, there).T
        if (np.hypot(x, y) > _MOVED_M).any() or (np.abs(np.sin(0.5 * turn)) > 0.5 * _MOVED_RAD).any():
            return True
        made = ~np.isin(now.ids, last.ids)
        order = np.argsort(ids := np.append(last.ids, now.ids[made]), kind="stable")
        self._last = KeyframePlaces(ids[order], np.vstack([last.poses, now.poses[made]])[order])
        return False

    def moved(self, poses: Sequence[SE2]) -> list[SE2]:
        """The poses after the correction: each has moved with the keyframe that was nearest."""
        rows = np.array([pose.as_array() for pose in poses]).reshape(-1, 3)
        for first in range(0, len(rows) if len(self._before) else 0, _AT_ONCE):
            some = rows[first : first + _AT_ONCE]
            nearest = np.linalg.norm(some[:, None, :2] - self._before[None, :, :2], axis=2).argmin(axis=1)
            rows[first : first + _AT_ONCE] = _composed(self._now[nearest], _relative(self._before[nearest], some))
        return [SE2(*row) for row in rows.tolist()]
