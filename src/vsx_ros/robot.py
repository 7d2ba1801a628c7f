"""The data that comes from a robot and goes to it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from vsx_ros.arrays import GrayImage
from vsx_ros.geometry.se2 import SE2

_STANDS_M_S, _STANDS_RAD_S = 0.01, 0.02  # the noise of encoders and gyro of a base that stands
# Twice the speed of a TurtleBot's wheels; faster motion comes from a reset counter or a flipped bit.
_MAX_SPEED_M_S, _MAX_TURN_RAD_S, _FAR_M = 1.3, 6.0, 1e5
_SLACK_M, _SLACK_RAD = 0.05, 0.1  # beyond that: stamps are off by up to 40 ms
SILENCE_NS = 1_000_000_000  # without odometry: 30 to 50 readings are missing
# In a silence the base may have restarted. If not, it can hardly have been faster than before and after the silence.
_FASTER, _SILENT_M, _SILENT_RAD = 1.5, 0.3, 0.5
_ORIGIN_M, _ORIGIN_RAD = 0.001, 0.001  # a restarted base reports 0; rounding in messages is less
UNSURE_HEADING_RAD2 = 1.0  # in odometry messages: from this variance on, the heading counts as unknown
EMERGENCY_STOP = "emergency stop"
MAP_FRAME, ODOM_FRAME = "map", "odom"
BASE_FRAME, BODY_FRAME = "base_footprint", "base_link"  # on the floor, and the same above it
_JITTER_M = 0.002  # between two poses
_SPEED_OVER_NS = 100_000_000  # in a shorter time a step of 1 mm, as encoders have, looks like a speed
_CARRIED_NS = 200_000_000  # 10 readings: at full speed, changes of speed cause an error of 1 cm in that time
JOINED_NS = 500_000_000  # how the base moved between two readings farther apart is unknown


class Frame(NamedTuple):
    """One image of the camera.

    stamp_ns: start of exposure of the first row, in the clock of the odometry [ns].
    image: (H, W) uint8, not undistorted."""

    stamp_ns: int
    image: GrayImage


class DrivenDistance:
    """The length of the way by odometry [m]: smaller steps than _JITTER_M are noise of a standing base, and add up."""

    def __init__(self) -> None:
        self.distance_m = 0.0
        self._last: Odometry | None = None

    def add(self, odometry: Odometry) -> None:
        """The next reading; a new epoch begins a new stretch."""
        if self._last is None or self._last.odom_epoch != odometry.odom_epoch:
            self._last = odometry
        step_m = self._last.T_odom_base.distance_to(odometry.T_odom_base)
        if step_m > _JITTER_M:
            self.distance_m += step_m
            self._last = odometry


class OperatorHold(NamedTuple):
    """The operator holds the wheels: nothing that fails meanwhile is the fault of a goal or a plan. by: the emergency
    stop, or the source of the commands that the base obeys instead of navigation. since_ns: its beginning [ns]."""

    by: str
    since_ns: int

    def words(self) -> str:
        """The fact, and what ends it."""
        ends = "release it to go on" if self.by == EMERGENCY_STOP else "it goes on by itself when the wheels are let go"
        return f"the operator holds the wheels ({self.by}); {ends}"


class UserGoal(NamedTuple):
    """A goal that somebody else than the exploration has sent to move_base. client: its node."""

    identity: str
    client: str
    since_ns: int

    def words(self) -> str:
        """The fact, for people."""
        return f"driving to a goal of {self.client}; the exploration goes on after it"


class Odometry(NamedTuple):
    """Wheel odometry at an instant.

    T_odom_base: pose of the base in the odometry frame. It drifts, and jumps when the base's counting restarts.
    v: forward speed [m/s]. omega: turn rate, counter-clockwise positive [rad/s].
    trusted: False when the base says that its sensors contradict each other.
    odom_epoch: increases when counting restarts (``OdometryEpochs``); poses of two epochs must not be compared.
    wheel_turn: heading by the wheels alone if a gyro gives that of the pose, not wrapped [rad]; None: not reported."""

    stamp_ns: int
    T_odom_base: SE2
    v: float = 0.0
    omega: float = 0.0
    trusted: bool = True
    odom_epoch: int = 0
    wheel_turn: float | None = None

    @property
    def stands(self) -> bool:
        """Whether odometry says that the base stands."""
        return abs(self.v) < _STANDS_M_S and abs(self.omega) < _STANDS_RAD_S

    def towards(self, later: Odometry, stamp_ns: int) -> Odometry:
        """The odometry at an instant between this reading and a later one of its epoch."""
        ratio = (stamp_ns - self.stamp_ns) / (later.stamp_ns - self.stamp_ns)
        pose = self.T_odom_base.interpolate(later.T_odom_base, ratio)
        v = self.v + ratio * (later.v - self.v)
        omega = self.omega + ratio * (later.omega - self.omega)
        turn = self.wheel_turn
        if turn is not None:
            turn = None if later.wheel_turn is None else turn + ratio * (later.wheel_turn - turn)
        trusted = self.trusted and later.trusted
        return self._replace(stamp_ns=stamp_ns, T_odom_base=pose, v=v, omega=omega, trusted=trusted, wheel_turn=turn)

    @property
    def impossible(self) -> str:
        """Why no base can be there or move like this, in words; empty when one can."""
        pose, v, omega = self.T_odom_base, self.v, self.omega
        if not (pose.is_finite() and math.isfinite(v) and math.isfinite(omega)):
            return "odometry is not a number"
        if max(abs(pose.x), abs(pose.y)) > _FAR_M or abs(v) > _MAX_SPEED_M_S or abs(omega) > _MAX_TURN_RAD_S:
            return f"odometry at ({pose.x:g}, {pose.y:g}) m with {v:g} m/s and {omega:g} rad/s cannot be"
        return ""


class OdometryEpochs:
    """Detects when a base's counting restarts. Readings pass it once, where they enter the system."""

    def __init__(self, first: int = 0) -> None:
        """first: the first epoch."""
        self._epoch = first
        self._last: Odometry | None = None

    def enter(self, reading: Odometry) -> Odometry:
        """The reading with its epoch. An impossible reading does not begin a new epoch."""
        if not reading.impossible:
            if self._last is not None and _has_restarted(self._last, reading):
                self._epoch += 1
            self._last = reading
        return reading._replace(odom_epoch=self._epoch)


def _has_restarted(before: Odometry, now: Odometry) -> bool:
    """Whether no wheels can move the base so far in that time. After a silence also whether its speeds before and after
    were too slow for that, or it is back at the origin."""
    elapsed_ns = max(0, now.stamp_ns - before.stamp_ns)
    elapsed_s = 1e-9 * elapsed_ns
    distance, turn = before.T_odom_base.distance_to(now.T_odom_base), abs(before.T_odom_base.angle_to(now.T_odom_base))
    if distance > _MAX_SPEED_M_S * elapsed_s + _SLACK_M or turn > _MAX_TURN_RAD_S * elapsed_s + _SLACK_RAD:
        return True
    if elapsed_ns <= SILENCE_NS:
        return False
    fast_m = _FASTER * max(abs(before.v), abs(now.v)) * elapsed_s
    fast_rad = _FASTER * max(abs(before.omega), abs(now.omega)) * elapsed_s
    too_far = distance > fast_m + _SILENT_M or turn > fast_rad + _SILENT_RAD
    return too_far or (_is_origin(now.T_odom_base) and not _is_origin(before.T_odom_base))


def _is_origin(T_odom_base: SE2) -> bool:
    return T_odom_base.distance_to(SE2()) < _ORIGIN_M and abs(T_odom_base.angle_to(SE2())) < _ORIGIN_RAD


def odometry_at(readings: Sequence[Odometry], stamp_ns: int) -> Odometry | None:
    """The odometry at an instant, from readings ordered by time. Interpolates between two of one epoch at most 0.5 s
    apart, or extrapolates the last one before a gap or of an epoch at its speeds for at most 0.2 s. None otherwise."""
    i = bisect_right(readings, stamp_ns, key=lambda reading: reading.stamp_ns)
    if i == 0:
        return None
    before, after = readings[i - 1], readings[i] if i < len(readings) else None
    joined = after is not None and after.stamp_ns - before.stamp_ns <= JOINED_NS
    if after is not None and joined and after.odom_epoch == before.odom_epoch:
        return before.towards(after, stamp_ns)
    if stamp_ns - before.stamp_ns > _CARRIED_NS:
        return None
    seconds = (stamp_ns - before.stamp_ns) * 1e-9
    step = SE2.exp(before.v * seconds, before.omega * seconds)
    return before._replace(stamp_ns=stamp_ns, T_odom_base=before.T_odom_base @ step)


def with_speeds(reading: Odometry, before: Odometry) -> Odometry:
    """A reading that has only a pose, with speeds from the difference to the one before; where the pose was set, with
    the speeds of that one."""
    moving = _moving(reading, before)
    if moving is None or (moving.impossible and not reading.impossible):
        return reading._replace(v=before.v, omega=before.omega)
    return moving


def _moving(reading: Odometry, before: Odometry) -> Odometry | None:
    """The reading with speeds from the difference to the one before; None if that is as late."""
    moved, seconds = before.T_odom_base.inverse() @ reading.T_odom_base, (reading.stamp_ns - before.stamp_ns) * 1e-9
    if seconds <= 0.0:
        return None
    return reading._replace(v=moved.x / seconds, omega=moved.wrapped().theta / seconds)


class PoseSpeeds:
    """The speeds of odometry whose driver leaves them 0: from its poses. A driver that told a speed once is believed
    from then on."""

    def __init__(self) -> None:
        self._told = False
        self._recent: deque[Odometry] = deque(maxlen=100)

    def of(self, reading: Odometry) -> Odometry:
        """The next reading, with speeds over the last 0.1 s if it moved and has none."""
        self._told = self._told or reading.v != 0.0 or reading.omega != 0.0
        if self._told:
            return reading
        if self._recent and reading.stamp_ns < self._recent[-1].stamp_ns:
            self._recent.clear()
        self._recent.append(reading)
        while len(self._recent) > 1 and reading.stamp_ns - self._recent[1].stamp_ns >= _SPEED_OVER_NS:
            self._recent.popleft()
        moved = _moving(reading, self._recent[0]) or reading
        if moved.impossible:  # the pose was set
            self._recent.clear()
        return reading if moved.stands or moved.impossible else moved


class VelocityCommand(NamedTuple):
    """The command for the base: v forward [m/s], omega counter-clockwise [rad/s]."""

    v: float
    omega: float


STOP = VelocityCommand(0.0, 0.0)  # m/s, rad/s
