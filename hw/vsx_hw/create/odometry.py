"""Where a Create is: Create 2 by its encoders, Create 1 by its whole millimetres and degrees."""

from __future__ import annotations

import math
from collections import deque
from copy import copy

from vsx_hw.create.protocol import CREATE_1, CREATE_2, METRES_PER_TICK
from vsx_hw.readings import OdometryReading

LONGEST_GAP_S = 0.5
FASTEST_M_S = 1.0
SPEED_WINDOW = 5
SURELY_ROLLED_M = 0.03
COASTING_NS = 500_000_000
"""After a stop the wheels roll on for a moment; later counts come from someone who pushes the robot."""


class Pose:
    """A pose that is moved along arcs, with the speed of the last one."""

    def __init__(self) -> None:
        self.x_m = self.y_m = self.heading_rad = 0.0

    def advance(self, distance_m: float, turn_rad: float) -> None:
        """Along the arc, exactly."""
        half = 0.5 * turn_rad
        chord = distance_m if abs(half) < 1e-9 else distance_m * math.sin(half) / half
        self.x_m += chord * math.cos(self.heading_rad + half)
        self.y_m += chord * math.sin(self.heading_rad + half)
        self.heading_rad += turn_rad


class EncoderOdometry:
    """Create 2. Its encoders count but do not know the direction: the robot assumes the commanded one.

    Counts without a command are therefore not motion that can be trusted: they are left out and reported.
    """

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        self._scales = linear_scale, angular_scale
        self._pose = Pose()
        self._previous: tuple[int, int, int] | None = None
        self._driven_ns = 0
        self._wheels = (0.0, 0.0)
        self._travel: deque[tuple[int, float, float]] = deque([(0, 0.0, 0.0)], SPEED_WINDOW)
        self._gaps = 0

    def reset(self) -> None:
        """Start again at the origin; the counters' base line stays."""
        self._pose = Pose()

    def update(self, left_ticks: int, right_ticks: int, driving: bool, now_ns: int) -> OdometryReading:
        """The reading after one more pair of counts (16 bit); driving: whether the wheels were told to turn."""
        if driving:
            self._driven_ns = now_ns
        v = omega = 0.0
        trusted = True
        if self._previous is not None:
            left = METRES_PER_TICK * _signed(left_ticks - self._previous[0])
            right = METRES_PER_TICK * _signed(right_ticks - self._previous[1])
            dt_s = (now_ns - self._previous[2]) * 1e-9
            if dt_s > LONGEST_GAP_S or max(abs(left), abs(right)) > FASTEST_M_S * max(dt_s, 0.03):
                self._gaps += 1
            elif now_ns - self._driven_ns > COASTING_NS:
                trusted = left == right == 0.0
            else:
                v, omega = self._move(left, right, now_ns)
        self._previous = left_ticks, right_ticks, now_ns
        p = self._pose
        return OdometryReading(now_ns, p.x_m, p.y_m, p.heading_rad, v, omega, self._gaps, trusted, self._wheels)

    def _move(self, left: float, right: float, now_ns: int) -> tuple[float, float]:
        """Advance the pose; the speeds are means over a few reports, because their arrival is not even."""
        distance = 0.5 * (left + right) * self._scales[0]
        turn = (right - left) / CREATE_2.wheel_base_m * self._scales[1]
        self._pose.advance(distance, turn)
        self._wheels = (self._wheels[0] + left, self._wheels[1] + right)
        then_ns, distance_then, turn_then = self._travel[0]
        _, distance_before, turn_before = self._travel[-1]
        self._travel.append((now_ns, distance_before + distance, turn_before + turn))
        dt_s = (now_ns - then_ns) * 1e-9
        if not 0.0 < dt_s < LONGEST_GAP_S:
            return 0.0, 0.0
        return (distance_before + distance - distance_then) / dt_s, (turn_before + turn - turn_then) / dt_s


class DistanceOdometry:
    """Create 1. Its distance and angle are whole millimetres and degrees, zeroed by each reading, so they are read
    seldom; in between the pose follows the commanded speeds and is corrected at the next reading. Where the power board
    has a gyro, the turn is the gyro's throughout."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        self._scales = linear_scale, angular_scale
        self._measured = Pose()
        self._shown = Pose()
        self._then_ns = 0
        self._speeds = (0.0, 0.0)
        self._wheels = (0.0, 0.0)
        self._gaps = 0
        self._trusted = True
        self._expected_m = 0.0  # way of the faster wheel, by the commands since the last reading of the distance
        self._held = False
        self._gyro_turn: float | None = 0.0  # since the last reading of the distance; None when the gyro was silent

    def reset(self) -> None:
        """Start again at the origin."""
        self._measured, self._shown = Pose(), Pose()

    def command(self, v_m_s: float, omega_rad_s: float) -> None:
        """What the robot was told last."""
        self._speeds = v_m_s, omega_rad_s

    def lose(self) -> None:
        """A reading was lost, and with it the motion since the one before."""
        self._gaps += 1
        self._trusted = False

    def measure(self, distance_mm: int, angle_deg: int) -> None:
        """Distance and angle since the last reading; impossible values count as lost."""
        gyro_turn, self._gyro_turn = self._gyro_turn, 0.0
        if abs(distance_mm) > 1000 or abs(angle_deg) > 57:
            self.lose()
            return
        measured = math.radians(angle_deg) if gyro_turn is None else gyro_turn
        rolled_m = abs(distance_mm) / 1000.0 + 0.5 * CREATE_1.wheel_base_m * abs(measured)
        self._held = self._expected_m > SURELY_ROLLED_M and rolled_m < 0.1 * self._expected_m
        self._expected_m = 0.0
        distance, turn = distance_mm / 1000.0 * self._scales[0], measured * self._scales[1]
        self._measured.advance(distance, turn)
        half = 0.5 * CREATE_1.wheel_base_m * turn
        self._wheels = (self._wheels[0] + distance - half, self._wheels[1] + distance + half)
        self._shown = copy(self._measured)
        self._trusted = True

    def reading(self, now_ns: int, gyro_rad_s: float | None = None) -> OdometryReading:
        """The pose now; gyro_rad_s is the measured rate where there is one."""
        dt_s = min((now_ns - self._then_ns) * 1e-9, 0.1) if self._then_ns else 0.0
        self._then_ns = now_ns
        v, omega = self._speeds
        self._expected_m += (abs(v) + 0.5 * CREATE_1.wheel_base_m * abs(omega)) * dt_s
        if self._held:
            v = omega = 0.0
        if gyro_rad_s is None:
            self._gyro_turn = None
        else:
            omega = gyro_rad_s * self._scales[1]
            if self._gyro_turn is not None:
                self._gyro_turn += gyro_rad_s * dt_s
        self._shown.advance(v * dt_s, omega * dt_s)
        p = self._shown
        return OdometryReading(now_ns, p.x_m, p.y_m, p.heading_rad, v, omega, self._gaps, self._trusted, self._wheels)


def _signed(difference: int) -> int:
    """The smallest step of a 16-bit counter."""
    return (difference + 0x8000) % 0x10000 - 0x8000
