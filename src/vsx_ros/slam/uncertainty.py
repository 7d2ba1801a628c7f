"""How well a camera pose is known: the image against the map around it, that part of the map against its beginning, and
odometry since the last image that was tracked.

Covariances are of xi = (translation [m], rotation [rad]) in the camera's own axes: T_true = T_estimated exp(xi)."""

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config.maps import UncertaintyConfig
from vsx_ros.geometry.se3 import SE3, skew
from vsx_ros.slam.keyframe import MapView
from vsx_ros.slam.local_map import LINKED_POINTS, LocalMap
from vsx_ros.slam.tracker import Track

_CERTAIN = 1e-12  # added to what an image tells, so that one with few points has a covariance, too


def carried(covariance: FloatArray, T_a_b: SE3) -> FloatArray:
    """The covariance (6, 6) of frame a, as that of frame b which is fixed to it (Barfoot 2017, eq. 7.75)."""
    R = T_a_b.rotation.T
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = R
    adjoint[:3, 3:] = -R @ skew(T_a_b.translation)
    return np.asarray(adjoint @ covariance @ adjoint.T)


class PoseUncertainty:
    """``enter`` each new local map, then ask for the pose of a frame tracked in it (``tracked``) or not (``moved``).

    What two keyframes that share points know of each other is added up along the surest way from keyframe 0 to the
    reference keyframe. Ways are found as the camera goes: each local map passes what is known on to the keyframes in
    it. After a loop is closed, the shorter way makes the pose surer again."""

    def __init__(self, config: UncertaintyConfig) -> None:
        self._config = config
        self._known: dict[int, FloatArray] = {}
        self.covariance: FloatArray = np.zeros((6, 6))

    def enter(self, local: LocalMap) -> None:
        """Take in a local map: its reference is known by its neighbours, then they by it."""
        view, near = local.view, local.near
        reference = local.reference
        if not any(k in self._known for k in view.living.tolist()):
            self._begin(view)
        tied = [(int(k), int(n)) for k, n in zip(near, local.shared) if n >= LINKED_POINTS and int(k) != reference]
        for k, points in tied:
            self._pass_on(view, k, reference, points)
        for k, points in tied:
            self._pass_on(view, reference, k, points)

    def _begin(self, view: MapView) -> None:
        """A map's first keyframe is where it says; in a map made before, each is known by the one before it."""
        living: IntArray = view.living
        self._known[int(living[0])] = np.zeros((6, 6))
        for a, b in zip(living[:-1].tolist(), living[1:].tolist()):
            self._pass_on(view, a, b, LINKED_POINTS)

    def _pass_on(self, view: MapView, a: int, b: int, points: int) -> None:
        """Keyframe b is known by a, if that is better than what is known of it. points: they share."""
        if a not in self._known:
            return
        T_a_b = view.keyframes[a].T_world_cam.inverse() @ view.keyframes[b].T_world_cam
        depth, config = float(view.depths[b]), self._config
        way_m = float(np.linalg.norm(T_a_b.translation))
        metres2 = (config.shared_depth_ratio * depth) ** 2 / points + config.distance_sigma_sqrt_m**2 * way_m
        radians2 = config.shared_turn_rad**2 / points + config.turn_sigma_rad_sqrt_m**2 * way_m
        covariance = carried(self._known[a], T_a_b) + np.diag(np.repeat([metres2, radians2], 3))
        if b not in self._known or _size(covariance, depth) < _size(self._known[b], depth):
            self._known[b] = covariance

    def tracked(self, track: Track, local: LocalMap) -> FloatArray:
        """(6, 6) of a frame whose pose was found in the local map."""
        view, reference = local.view, local.reference
        T_ref_cam = view.keyframes[reference].T_world_cam.inverse() @ track.T_world_cam
        seen = np.linalg.inv(track.information + _CERTAIN * np.eye(6)) * self._config.image_factor
        of_map = self._known.get(reference, np.zeros((6, 6)))
        from_start = view.keyframes[int(view.living[0])].T_world_cam.inverse() @ track.T_world_cam
        along = from_start.rotation.T @ from_start.translation * self._config.size_sigma_ratio
        self.covariance = carried(of_map, T_ref_cam) + 0.5 * (seen + seen.T)
        self.covariance[:3, :3] += np.outer(along, along)
        return self.covariance

    def moved(self, T_before_now: SE3, information: FloatArray) -> FloatArray:
        """(6, 6) of a frame that odometry alone tells, since the last one. information (6,): of that motion."""
        self.covariance = carried(self.covariance, T_before_now) + np.diag(1.0 / information)
        return self.covariance


def _size(covariance: FloatArray, depth_m: float) -> float:
    """Variance of where a point of the scene is put [m^2]."""
    return float(np.trace(covariance[:3, :3]) + depth_m**2 * np.trace(covariance[3:, 3:]))
