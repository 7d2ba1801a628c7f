"""The base's odometry at each image, continuous even where the odometry is not."""

from __future__ import annotations

import math
from collections.abc import Callable

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

MAX_AGE_S = 0.25


class ContinuousOdometry:
    """``at`` one image after the other. gap: told (stamp_ns, reason) when a reading cannot be used as it is."""

    def __init__(self, gap: Callable[[int, str], None]) -> None:
        self._gap = gap
        self._last: tuple[int, SE2, int] | None = None
        self._T_continuous_odom = SE2()

    def at(self, stamp_ns: int, odometry: Odometry | None) -> SE2 | None:
        """The pose of the base as odometry has counted it up to the image, None when it cannot be told.

        A new epoch is not followed: the base is taken to have moved on as fast as the reading says, and the counting
        goes on from there.
        """
        if odometry is None:
            return None
        age = (stamp_ns - odometry.stamp_ns) * 1e-9
        if reason := odometry.impossible or _out_of_date(age):
            self._gap(stamp_ns, f"{reason}: ignored for this frame")
            return None
        raw = odometry.T_odom_base @ SE2.exp(odometry.v * age, 0.0, odometry.omega * age)
        counted = self._T_continuous_odom @ raw
        if self._last is not None and self._last[2] != odometry.odom_epoch:
            last_ns, last, _ = self._last
            elapsed = (stamp_ns - last_ns) * 1e-9
            jump = f"{last.distance_to(counted):.2f} m and {math.degrees(abs(last.angle_to(counted))):.0f} deg"
            self._gap(stamp_ns, f"odometry jumped by {jump} in {elapsed:.2f} s: counted on from where it was")
            counted = last @ SE2.exp(odometry.v * elapsed, 0.0, odometry.omega * elapsed)
            self._T_continuous_odom = counted @ raw.inverse()
        self._last = stamp_ns, counted, odometry.odom_epoch
        return counted


def _out_of_date(age: float) -> str:
    if abs(age) <= MAX_AGE_S:
        return ""
    return f"odometry is {abs(age):.2f} s {'older' if age > 0.0 else 'newer'} than the image"
