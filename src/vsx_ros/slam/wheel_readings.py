"""The base's odometry at each image, continuous even where the odometry is not."""

from __future__ import annotations

import math
from collections.abc import Callable

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import MAX_SPEED_M_S, MAX_TURN_RAD_S, SILENCE_NS, Odometry, why_jumped

MAX_AGE_S = 0.25
FAR_M = 1e5
# In a silence the base may have been started anew. One that has not can hardly have gone on faster than it was and is.
FASTER, SILENT_M, SILENT_RAD = 1.5, 0.3, 0.5


class WheelReadings:
    """``at`` one image after the other. gap: told (stamp_ns, reason) when a reading cannot be used as it is."""

    def __init__(self, gap: Callable[[int, str], None]) -> None:
        self._gap = gap
        self._last: tuple[int, SE2, Odometry] | None = None
        self._T_counted_odom = SE2()

    def at(self, stamp_ns: int, odometry: Odometry | None) -> SE2 | None:
        """The pose of the base as the wheels have counted it up to the image, None when it cannot be told.

        A reading that jumps is not followed: the base is taken to have moved on as fast as the reading says, and the
        counting goes on from there.
        """
        if odometry is None:
            return None
        age = (stamp_ns - odometry.stamp_ns) * 1e-9
        if reason := _unusable(odometry, age):
            self._gap(stamp_ns, f"{reason}: ignored for this frame")
            return None
        raw = odometry.T_odom_base @ SE2.exp(odometry.v * age, 0.0, odometry.omega * age)
        counted = self._T_counted_odom @ raw
        if self._last is not None:
            last_ns, last, before = self._last
            elapsed = (stamp_ns - last_ns) * 1e-9
            if jump := why_jumped(last, counted, elapsed) or _why_anew(last, counted, elapsed, (before, odometry)):
                self._gap(stamp_ns, f"odometry jumped by {jump}: counted on from where it was")
                counted = last @ SE2.exp(odometry.v * elapsed, 0.0, odometry.omega * elapsed)
                self._T_counted_odom = counted @ raw.inverse()
        self._last = stamp_ns, counted, odometry
        return counted


def _unusable(odometry: Odometry, age: float) -> str:
    """Why a reading cannot tell where the base is; empty when it can."""
    pose, v, omega = odometry.T_odom_base, odometry.v, odometry.omega
    if not (pose.is_finite() and math.isfinite(v) and math.isfinite(omega)):
        return "odometry is not a number"
    if max(abs(pose.x), abs(pose.y)) > FAR_M or abs(v) > MAX_SPEED_M_S or abs(omega) > MAX_TURN_RAD_S:
        return f"odometry at ({pose.x:g}, {pose.y:g}) m with {v:g} m/s and {omega:g} rad/s cannot be"
    if abs(age) > MAX_AGE_S:
        return f"odometry is {abs(age):.2f} s {'older' if age > 0.0 else 'newer'} than the image"
    return ""


def _why_anew(last: SE2, now: SE2, elapsed_s: float, readings: tuple[Odometry, Odometry]) -> str:
    """How far the base moved in a silence, where it was too slow for that before and after; empty where it was not."""
    if elapsed_s <= 1e-9 * SILENCE_NS:
        return ""
    distance, turn = last.distance_to(now), abs(last.angle_to(now))
    fast_m = FASTER * max(abs(reading.v) for reading in readings) * elapsed_s
    fast_rad = FASTER * max(abs(reading.omega) for reading in readings) * elapsed_s
    if distance <= fast_m + SILENT_M and turn <= fast_rad + SILENT_RAD:
        return ""
    return f"{distance:.2f} m and {math.degrees(turn):.0f} deg in {elapsed_s:.1f} s of silence"
