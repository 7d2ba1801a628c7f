"""Where the camera should be now: by odometry where there is any, else by constant velocity and image rotation."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.vision.small_image import rotation_between

DAMPING = 0.9
MAX_GAP_S = 0.5


class Prediction(NamedTuple):
    """T_world_cam expected, whether it comes from odometry, and how firmly: information (6,) per axis of the camera's
    tangent."""

    T_world_cam: SE3
    by_odometry: bool
    information: FloatArray


def motion_by_odometry(T_base_cam: SE3 | None, before: FrameData, now: FrameData) -> SE3 | None:
    """T_before_now of the camera by odometry, None without."""
    if T_base_cam is None or before.T_odom_base is None or now.T_odom_base is None:
        return None
    return T_base_cam.inverse() @ SE3.from_se2(before.T_odom_base.inverse() @ now.T_odom_base) @ T_base_cam


class MotionModel:
    """Holds the last pose. ``predict`` does not change it, ``update`` does."""

    def __init__(self, T_base_cam: SE3 | None, focal_px: float) -> None:
        self._T_base_cam = T_base_cam
        self._focal_px = focal_px
        self._velocity: FloatArray = np.zeros(6)
        self._last: tuple[FrameData, SE3] | None = None

    def predict(self, data: FrameData) -> Prediction:
        """The expected pose of a frame. Needs an ``update`` before."""
        assert self._last is not None
        before, T = self._last
        by_odometry = self.by_odometry(before, data)
        if by_odometry is not None:
            distance = float(np.linalg.norm(by_odometry.translation))
            turn = by_odometry.rotation_angle_to(SE3.identity())
            sigma = np.repeat([0.0006 + 0.01 * distance, 0.0006 + 0.01 * turn], 3)
            return Prediction(T @ by_odometry, True, sigma**-2)
        dt = (data.stamp_ns - before.stamp_ns) * 1e-9
        if dt > MAX_GAP_S:
            return Prediction(T, False, np.zeros(6))
        motion = SE3.exp(self._velocity * dt * DAMPING)
        rotation, score = rotation_between(before.small, data.small, self._focal_px)
        if math.isfinite(score):
            motion = SE3(rotation.T, motion.translation)
        return Prediction(T @ motion, False, np.zeros(6))

    def by_odometry(self, before: FrameData, now: FrameData) -> SE3 | None:
        """T_before_now of the camera by odometry, None without."""
        return motion_by_odometry(self._T_base_cam, before, now)

    @property
    def last_pose(self) -> SE3 | None:
        """T_world_cam of the latest update."""
        return None if self._last is None else self._last[1]

    def update(self, data: FrameData, T_world_cam: SE3, measured: bool) -> None:
        """Take the pose a frame was found at; an unmeasured one keeps no velocity."""
        self._velocity = np.zeros(6)
        if measured and self._last is not None:
            before, T = self._last
            dt = (data.stamp_ns - before.stamp_ns) * 1e-9
            if 0 < dt <= MAX_GAP_S:
                self._velocity = (T.inverse() @ T_world_cam).log() / dt
        self._last = (data, T_world_cam)

    def move(self, T_world_cam: SE3, factor: float) -> None:
        """The last pose after the map moved under it and became ``factor`` times as large."""
        if self._last is not None:
            self._last = (self._last[0], T_world_cam)
            self._velocity[:3] *= factor
