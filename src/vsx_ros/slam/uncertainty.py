"""Covariance of a camera pose: of the image against the local map, of the local map against the map's beginning, and of
odometry since the last tracked image.

Covariances are of xi = (translation [m], rotation [rad]) in the camera's own axes: T_true = T_estimated exp(xi)."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config.maps import UncertaintyConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import MapView
from vsx_ros.slam.local_map import LINKED_POINTS, LocalMap
from vsx_ros.slam.track import Track

_CERTAIN = 1e-12  # added to an image's information, so that few points have a covariance, too


def carried(covariance: FloatArray, T_a_b: SE3) -> FloatArray:
    """The covariance (6, 6) of frame a, transformed to frame b, which is fixed to it (Barfoot 2017, eq. 7.75)."""
    return _carried(covariance, T_a_b.rotation, T_a_b.translation)


def _carried(covariance: FloatArray, R_a_b: FloatArray, t_a_b: FloatArray) -> FloatArray:
    """The same for (..., 6, 6), rotations (..., 3, 3) and translations (..., 3) at once."""
    R_b_a, t = np.swapaxes(R_a_b, -1, -2), t_a_b
    adjoint, skew = np.zeros((*t.shape[:-1], 6, 6)), np.zeros((*t.shape[:-1], 3, 3))
    for row, column, axis in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        skew[..., row, column], skew[..., column, row] = t[..., axis], -t[..., axis]
    adjoint[..., :3, :3] = adjoint[..., 3:, 3:] = R_b_a
    adjoint[..., :3, 3:] = -R_b_a @ skew
    return np.asarray(adjoint @ covariance @ np.swapaxes(adjoint, -1, -2))


class _Placed(NamedTuple):
    """The newest pose in a map, and its covariance relative to the map's first keyframe, without that of its size."""

    map_id: int
    T_world_cam: SE3
    covariance: FloatArray


class PoseUncertainty:
    """``enter`` each new local map, then ask for the pose of a frame tracked in it (``tracked``) or not (``moved``).

    Covariances between keyframes that share points are summed along the most certain path from keyframe 0 to the
    reference keyframe. Paths are found as the camera moves: each local map updates the keyframes in it. After a loop
    closure, the shorter path makes the pose more certain again. Keyframes beyond a gap that odometry bridged share no
    points with those before it: there the path goes on from the newest pose."""

    def __init__(self, config: UncertaintyConfig) -> None:
        self._config = config
        # Keyframes whose covariance is known, relative to the first of this map.
        self._known: BoolArray = np.zeros(0, np.bool_)
        self._map_id: IntArray = np.zeros(0, np.int64)
        self._of_keyframe: FloatArray = np.zeros((0, 6, 6))
        self.covariance: FloatArray = np.zeros((6, 6))
        self._placed: _Placed | None = None  # None where the path to the reference keyframe is unknown

    def enter(self, local: LocalMap) -> None:
        """Update from a local map: its reference from the neighbours, then the neighbours from the reference."""
        view, reference = local.view, np.array([local.reference])
        more = len(view.keyframes) - len(self._known)
        self._known = np.append(self._known, np.zeros(more, np.bool_))
        self._of_keyframe = np.append(self._of_keyframe, np.zeros((more, 6, 6)), axis=0)
        self._map_id = np.append(self._map_id, [k.map_id for k in view.keyframes[len(self._map_id) :]])
        self._forget_joined(view, np.append(local.near, local.reference))
        if not self._known[view.living].any():
            self._begin(view)
        tied = (local.shared >= LINKED_POINTS) & (local.near != local.reference)
        near, points = local.near[tied], local.shared[tied]
        self._pass_on(view, near, reference, points)
        if not self._known[local.reference]:
            self._go_on(view, local.reference)
        self._pass_on(view, reference, near, points)

    def _go_on(self, view: MapView, reference: int) -> None:
        """Compute a keyframe from the newest pose, to which odometry has led."""
        placed, keyframe = self._placed, view.keyframes[reference]
        if placed is not None and placed.map_id == keyframe.map_id:
            T_cam_ref = placed.T_world_cam.inverse() @ keyframe.T_world_cam
            self._of_keyframe[reference] = carried(placed.covariance, T_cam_ref)
            self._known[reference] = True

    def _forget_joined(self, view: MapView, near: IntArray) -> None:
        """Covariances of keyframes whose map was joined with another count from another keyframe."""
        map_id = np.array([view.keyframes[k].map_id for k in near.tolist()], np.int64)
        joined = near[map_id != self._map_id[near]]
        self._known[joined], self._map_id[near] = False, map_id

    def _begin(self, view: MapView) -> None:
        """The first keyframe of a map has covariance 0; in a loaded map each next one follows from the one before."""
        living: IntArray = view.living
        self._known[living[0]] = True
        for k in range(len(living) - 1):
            self._pass_on(view, living[k : k + 1], living[k + 1 : k + 2], np.array([LINKED_POINTS]))

    def _pass_on(self, view: MapView, a: IntArray, b: IntArray, points: IntArray) -> None:
        """Compute keyframes b from keyframes a (one of the two is a single one), where that is better than before.
        points: each pair shares."""
        a, b = np.broadcast_arrays(a, b)
        a, b, points = (column[self._known[a]] for column in (a, b, points))
        if not len(a):
            return
        config, depth, R_a = self._config, view.depths[b], view.R_world_cam[a]
        t_a_b = np.einsum("nji,nj->ni", R_a, view.centres[b] - view.centres[a])
        way_m = np.linalg.norm(t_a_b, axis=1)
        metres2 = (config.shared_depth_ratio * depth) ** 2 / points + config.distance_sigma_sqrt_m**2 * way_m
        radians2 = config.shared_turn_rad**2 / points + config.turn_sigma_rad_sqrt_m**2 * way_m
        covariance = _carried(self._of_keyframe[a], np.swapaxes(R_a, 1, 2) @ view.R_world_cam[b], t_a_b)
        covariance[:, range(6), range(6)] += np.repeat(np.column_stack([metres2, radians2]), 3, axis=1)
        size = _size(covariance, depth)
        better = ~self._known[b] | (size < _size(self._of_keyframe[b], depth))
        order = np.argsort(-size[better], kind="stable")  # of several for one keyframe, the best is written last
        self._of_keyframe[b[better][order]] = covariance[better][order]
        self._known[b[better]] = True

    def tracked(self, track: Track, local: LocalMap) -> FloatArray:
        """(6, 6) covariance of a frame whose pose was found in the local map."""
        view, reference = local.view, local.reference
        T_ref_cam = view.keyframes[reference].T_world_cam.inverse() @ track.T_world_cam
        seen = np.linalg.inv(track.information + _CERTAIN * np.eye(6)) * self._config.image_factor
        of_map = self._of_keyframe[reference]
        of_pose = carried(of_map, T_ref_cam) + 0.5 * (seen + seen.T)
        map_id = view.keyframes[reference].map_id
        self._placed = _Placed(map_id, track.T_world_cam, of_pose) if self._known[reference] else None
        from_start = view.keyframes[int(view.living[0])].T_world_cam.inverse() @ track.T_world_cam
        along = from_start.rotation.T @ from_start.translation * self._config.size_sigma_ratio
        self.covariance = of_pose.copy()
        self.covariance[:3, :3] += np.outer(along, along)
        return self.covariance

    def moved(self, T_before_now: SE3, information: FloatArray) -> FloatArray:
        """(6, 6) covariance of a frame placed by odometry from the last one. information (6,): of that motion."""
        added, placed = np.diag(1.0 / information), self._placed
        self.covariance = carried(self.covariance, T_before_now) + added
        if placed is not None:
            covariance = carried(placed.covariance, T_before_now) + added
            self._placed = _Placed(placed.map_id, placed.T_world_cam @ T_before_now, covariance)
        return self.covariance


def _size(covariance: FloatArray, depth_m: FloatArray) -> FloatArray:
    """(N,) variance [m^2] of the position of a scene point, from covariances (N, 6, 6)."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    return np.asarray(variance[:, :3].sum(axis=1) + depth_m**2 * variance[:, 3:].sum(axis=1))
