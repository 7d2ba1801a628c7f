"""What comes from a robot and what goes to it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from vsx_ros.arrays import GrayImage
from vsx_ros.geometry.se2 import SE2

_STANDS_M_S, _STANDS_RAD_S = 0.01, 0.02
# Twice what a TurtleBot's wheels can do; what moves faster is a counter that was reset or a bit that fell over.
MAX_SPEED_M_S, MAX_TURN_RAD_S = 1.3, 6.0
_SLACK_M, _SLACK_RAD = 0.05, 0.1
SILENCE_NS = 1_000_000_000
_CARRIED_NS = 200_000_000


class Frame(NamedTuple):
    """One image of the camera.

    stamp_ns: start of exposure of the first row, in the clock of the odometry [ns].
    image: (H, W) uint8, not undistorted.
    """

    stamp_ns: int
    image: GrayImage


class Odometry(NamedTuple):
    """Wheel odometry at an instant.

    T_odom_base: pose of the base in the odometry frame. It drifts, and jumps where the base begins to count anew.
    v: forward speed [m/s]. omega: turn rate, counter-clockwise positive [rad/s].
    trusted: False where the base says that its sensors contradict each other.
    """

    stamp_ns: int
    T_odom_base: SE2
    v: float = 0.0
    omega: float = 0.0
    trusted: bool = True

    @property
    def stands(self) -> bool:
        """Whether the wheels report that they stand."""
        return abs(self.v) < _STANDS_M_S and abs(self.omega) < _STANDS_RAD_S

    def towards(self, later: Odometry, stamp_ns: int) -> Odometry:
        """At an instant between this reading and a later one."""
        ratio = (stamp_ns - self.stamp_ns) / (later.stamp_ns - self.stamp_ns)
        pose = self.T_odom_base.interpolate(later.T_odom_base, ratio)
        v = self.v + ratio * (later.v - self.v)
        omega = self.omega + ratio * (later.omega - self.omega)
        return Odometry(stamp_ns, pose, v, omega, self.trusted and later.trusted)

    def carried_on(self, stamp_ns: int) -> Odometry:
        """At an instant after this reading, its speeds held."""
        seconds = (stamp_ns - self.stamp_ns) * 1e-9
        pose = self.T_odom_base @ SE2.exp(self.v * seconds, 0.0, self.omega * seconds)
        return self._replace(stamp_ns=stamp_ns, T_odom_base=pose)

    def counts_on_from(self, before: Odometry) -> bool:
        """Whether the two readings are surely of one counting: not where the pose jumps, nor after a second of silence,
        in which the base may have been started anew."""
        elapsed_ns = self.stamp_ns - before.stamp_ns
        return elapsed_ns <= SILENCE_NS and why_jumped(before.T_odom_base, self.T_odom_base, 1e-9 * elapsed_ns) == ""


def odometry_at(readings: Sequence[Odometry], stamp_ns: int) -> Odometry | None:
    """At an instant, of readings by time: between two of them, or after the last at its speeds for at most 0.2 s."""
    i = bisect_right(readings, stamp_ns, key=lambda reading: reading.stamp_ns)
    if i == 0:
        return None
    before = readings[i - 1]
    if i < len(readings):
        return before.towards(readings[i], stamp_ns)
    return before.carried_on(stamp_ns) if stamp_ns - before.stamp_ns <= _CARRIED_NS else None


def why_jumped(before: SE2, now: SE2, elapsed_s: float) -> str:
    """How far the pose of the base moved, where no wheels can move it so far in that time; empty where they can."""
    distance, turn = before.distance_to(now), abs(before.angle_to(now))
    if distance <= MAX_SPEED_M_S * elapsed_s + _SLACK_M and turn <= MAX_TURN_RAD_S * elapsed_s + _SLACK_RAD:
        return ""
    return f"{distance:.2f} m and {math.degrees(turn):.0f} deg in {elapsed_s:.2f} s"


class VelocityCommand(NamedTuple):
    """What the base shall do now: v forward [m/s], omega counter-clockwise [rad/s]."""

    v: float
    omega: float


STOP = VelocityCommand(0.0, 0.0)
