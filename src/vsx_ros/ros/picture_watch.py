"""Whether a camera shows what is before it, or again and again what was before it a while ago."""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import GrayImage
from vsx_ros.robot import Odometry
from vsx_ros.slam.preprocessing import STILL_M, STILL_RAD


class RepeatedImageDetector:
    """Noise makes every picture of a living camera differ; a perfect one repeats itself only where the base stands."""

    def __init__(self) -> None:
        self._first: tuple[GrayImage, Odometry] | None = None

    def is_new(self, image: GrayImage, odometry: Odometry | None) -> bool:
        """Whether the picture differs from the one before, or the base stands where that one was first shown."""
        if self._first is None or odometry is None or not np.array_equal(image, self._first[0]):
            self._first = None if odometry is None else (image, odometry)
            return True
        then, now = self._first[1].T_odom_base, odometry.T_odom_base
        return then.distance_to(now) < STILL_M and abs(then.angle_to(now)) < STILL_RAD
