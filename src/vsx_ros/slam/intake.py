"""What comes in, checked and taken apart: image, stamp, odometry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.pyramid import build_pyramid
from vsx_ros.vision.small_image import small_image

GAP_S = 1.0
MAX_ODOMETRY_AGE_S = 0.25


class Intake:
    """``take`` one frame after the other. gap: told (stamp_ns, reason) when time or odometry has a hole."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, gap: Callable[[int, str], None]) -> None:
        self._camera = camera
        self._T_base_cam = T_base_cam
        self._gap = gap
        self._detector = CornerDetector()
        self._last_stamp_ns: int | None = None

    def take(self, frame: Frame, odometry: Odometry | None) -> FrameData:
        """The next frame. Raises InputError for an image of the wrong size or type and a stamp that does not advance;
        nothing has changed then."""
        camera = self._camera
        pyramid = build_pyramid(frame.image)
        if frame.image.shape != (camera.height, camera.width):
            height, width = frame.image.shape
            raise InputError(
                f"image of {width}x{height} does not fit the calibration for {camera.width}x{camera.height}; "
                "calibrate at this size or set the camera to the calibrated one"
            )
        last = self._last_stamp_ns
        if last is not None and frame.stamp_ns <= last:
            raise InputError(
                f"frame stamp {frame.stamp_ns} ns is not after the one before, {last} ns; frames must come in order"
            )
        if last is not None and (frame.stamp_ns - last) * 1e-9 > GAP_S:
            self._gap(frame.stamp_ns, f"no frame for {(frame.stamp_ns - last) * 1e-9:.1f} s")
        self._last_stamp_ns = frame.stamp_ns
        wheels = self._odometry_at(frame.stamp_ns, odometry)
        return FrameData(frame.stamp_ns, pyramid, self._detector.detect(pyramid), small_image(pyramid), wheels)

    def _odometry_at(self, stamp_ns: int, odometry: Odometry | None) -> SE2 | None:
        """The base's odometry pose at the instant of the image, None when it cannot be told."""
        if odometry is None or self._T_base_cam is None:
            return None
        age = (stamp_ns - odometry.stamp_ns) * 1e-9
        numbers = (odometry.v, odometry.omega)
        if not (odometry.T_odom_base.is_finite() and np.isfinite(numbers).all()):
            self._gap(stamp_ns, "odometry is not a number: ignored for this frame")
            return None
        if abs(age) > MAX_ODOMETRY_AGE_S:
            self._gap(stamp_ns, f"odometry is {age:.2f} s older than the image: ignored for this frame")
            return None
        return odometry.T_odom_base @ SE2.exp(odometry.v * age, 0.0, odometry.omega * age)
