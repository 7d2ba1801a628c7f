"""When and how turned each row of an image was exposed: rolling shutter, with the motion that odometry tells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ShutterConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.vision.patch_search import kernel_camera, moving


class Exposure(NamedTuple):
    """camera (18,): the kernels' array of an image; T_middle_stamp: the camera at the image's stamp, the start of its
    first row, as seen from the middle."""

    camera: FloatArray
    T_middle_stamp: SE3


class RollingShutter:
    """How a camera on wheels exposes. The map's poses and odometry are those of the middle: ``middle_ns`` after the
    stamp, half of the middle row's time."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: ShutterConfig) -> None:
        self._standing = kernel_camera(camera)
        self._T_base_cam = T_base_cam
        self._T_cam_base = SE3.identity() if T_base_cam is None else T_base_cam.inverse()
        self._readout_s = config.readout_s
        self._middle_s = 0.5 * (config.exposure_s + config.readout_s)
        self.middle_ns = round(1e9 * self._middle_s)

    def exposure(self, odometry: Odometry | None) -> Exposure:
        """Of an image taken at the speed of an odometry reading; without one, standing still."""
        if odometry is None or self._T_base_cam is None:
            return Exposure(self._standing, SE3.identity())
        back = SE2.exp(-odometry.v * self._middle_s, 0.0, -odometry.omega * self._middle_s)
        T_middle_stamp = self._T_cam_base @ SE3.from_se2(back) @ self._T_base_cam
        return Exposure(moving(self._standing, self._motion(odometry)), T_middle_stamp)

    def _motion(self, odometry: Odometry) -> FloatArray:
        """(6,) rotation vector and way of the camera, in its own frame, during the readout."""
        assert self._T_base_cam is not None
        forward, left, _ = self._T_base_cam.translation.tolist()
        turn = np.array([0.0, 0.0, odometry.omega])
        way = np.array([odometry.v - odometry.omega * left, odometry.omega * forward, 0.0])
        R_cam_base = self._T_base_cam.rotation.T
        return np.concatenate([R_cam_base @ turn, R_cam_base @ way]) * self._readout_s
