"""The pose of a Create. Create 2 uses encoders. Create 1 uses its whole millimetres and degrees, and the gyro of the
TurtleBot 1's power board: one analog axis on the Create's cargo bay input (packet 33).

Sources: Analog Devices ADXRS613 data sheet (12.5 mV per deg/s about 2.5 V, 150 deg/s). The TurtleBot's own driver
calibrates with the factor 1.35 (0.395 deg/s per count; the data sheet alone gives 0.391)."""

import math
from collections import deque
from copy import copy

from vsx_hw.create.protocol import CREATE_1, CREATE_2, METRES_PER_TICK
from vsx_hw.odometry import PlanarPose, WheelOdometry, signed
from vsx_hw.plausibility import WINDOW_NS, MotionCheck
from vsx_hw.readings import GyroReading, OdometryReading

LONGEST_GAP_S = 0.5  # over longer ones counters may have wrapped or the robot may have been carried
FASTEST_M_S = 0.6  # of a wheel; the robot drives 0.5
LONGEST_SPAN_S, LATE_M = 1.5, 0.1
"""Longest time between two readings of a Create 1's distance, 25 commands of 50 ms; what a late answer may add."""
SPEED_WINDOW = 5  # reports over which the speed is taken: encoders step coarsely
CORRECTION_M, CORRECTION_RAD = 0.03, 0.02
"""Largest correction of the shown pose per report: a jump would look like a base that restarted at zero."""
LOST = "a report of the motion is lost or cannot be: it is not known how far the base went"
COASTING_NS = 500_000_000
"""After a stop the wheels roll on for a moment; later counts come from someone who pushes the robot."""

RANGE_DEG_S = 150.0  # of the ADXRS613
_MIDDLE = 512.0  # counts at rest of a perfect gyro
RANGE_FACTOR = 1.35  # see above
ENOUGH_SAMPLES, MOST_SAMPLES = 50, 1000  # of a standing robot: to know the offset; at most in its mean
HEALTHY_OFFSET = (425.0, 575.0)  # of 1023 counts, around the middle of the range; others: unpowered, or turning
STILL_COUNTS = 8.0
"""Three deg/s: a robot that turns faster on a command to stand is being carried; its samples are not in the mean."""


class EncoderOdometry(WheelOdometry):
    """Create 2. Its encoders do not measure the direction: the robot assumes the commanded one. Counts without a
    command are therefore not trusted: they are left out and reported."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(MotionCheck(CREATE_2.wheel_base_m), linear_scale, angular_scale)
        self._previous: tuple[int, int, int] | None = None
        self._driven_ns = 0
        self._travel: deque[tuple[int, float, float]] = deque([(0, 0.0, 0.0)], SPEED_WINDOW)
        self._lost_ns = -WINDOW_NS

    def can_follow(self, left_ticks: int, right_ticks: int, now_ns: int) -> bool:
        """Whether the wheels can have rolled so far since the last report."""
        left, right, dt_s = self._rolled(left_ticks, right_ticks, now_ns)
        return max(abs(left), abs(right)) <= FASTEST_M_S * max(dt_s, 0.03)

    def _rolled(self, left_ticks: int, right_ticks: int, now_ns: int) -> tuple[float, float, float]:
        """(left wheel distance [m], right wheel distance [m], seconds) since the last report."""
        left_then, right_then, then_ns = self._previous or (left_ticks, right_ticks, now_ns)
        left, right = signed(left_ticks - left_then, 0x10000), signed(right_ticks - right_then, 0x10000)
        return METRES_PER_TICK * left, METRES_PER_TICK * right, (now_ns - then_ns) * 1e-9

    def update(self, left_ticks: int, right_ticks: int, driving: bool, now_ns: int) -> OdometryReading:
        """The reading after one more pair of counts (16 bit); driving: whether the wheels were commanded to turn."""
        if driving:
            self._driven_ns = now_ns
        v = omega = 0.0
        trusted = True
        if self._previous is not None:
            left, right, dt_s = self._rolled(left_ticks, right_ticks, now_ns)
            if dt_s > LONGEST_GAP_S or not self.can_follow(left_ticks, right_ticks, now_ns):
                self._gaps += 1
                self._lost_ns = now_ns
                left = right = 0.0
            elif not 0 <= now_ns - self._driven_ns <= COASTING_NS:
                trusted = left == right == 0.0
            else:
                v, omega = self._move(left, right, now_ns)
            self._checked = self._check.step(now_ns, left, right)
        self._previous = left_ticks, right_ticks, now_ns
        return self._reading(now_ns, v, omega, LOST if 0 <= now_ns - self._lost_ns < WINDOW_NS else "", trusted)

    def _move(self, left: float, right: float, now_ns: int) -> tuple[float, float]:
        """Advance the pose; returns (v, omega), means over a few reports, because reports arrive unevenly."""
        distance = 0.5 * (left + right) * self._linear_scale
        turn = (right - left) / CREATE_2.wheel_base_m * self._angular_scale
        self._pose.advance(distance, turn)
        self._roll(left, right)
        then_ns, distance_then, turn_then = self._travel[0]
        _, distance_before, turn_before = self._travel[-1]
        self._travel.append((now_ns, distance_before + distance, turn_before + turn))
        dt_s = (now_ns - then_ns) * 1e-9
        if not 0.0 < dt_s < LONGEST_GAP_S:
            return 0.0, 0.0
        return (distance_before + distance - distance_then) / dt_s, (turn_before + turn - turn_then) / dt_s


class DistanceOdometry(WheelOdometry):
    """Create 1. Its distance and angle are whole millimetres and degrees, and each reading resets them, so they are
    read seldom. In between, the pose follows the commanded speeds, or the rate of a trusted gyro on the power board.
    The next reading corrects it."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(MotionCheck(CREATE_1.wheel_base_m, math.radians(0.5)), linear_scale, angular_scale)
        self._measured, self._best = PlanarPose(), PlanarPose()
        self._lost: PlanarPose | None = None  # the pose at the last loss since the last reading of the distance
        self._lost_turn = 0.0  # the gyro's until then
        self._then_ns = self._measured_ns = 0
        self._speeds = (0.0, 0.0)
        self._known, self._resets = True, False
        self._gyro_turn: float | None = 0.0  # since the last reading of the distance; None when the gyro was silent
        self._strange_ns = self._unsure_ns = -WINDOW_NS

    @property
    def gyro_trusted(self) -> bool:
        """Whether the gyro's latest rate is trusted."""
        return super().gyro_trusted and self._strange_ns != self._then_ns

    def reset(self) -> None:
        """See WheelOdometry; with the next reading, as this is another thread."""
        self._resets = True

    def _restart(self) -> None:
        """The best pose becomes the origin. The robot's next distance still counts from the measured one."""
        self._resets = False
        self._measured = self._measured.seen_from(self._best)
        self._lost = None if self._lost is None else self._lost.seen_from(self._best)
        self._best, self._pose = PlanarPose(), PlanarPose()

    def command(self, v_m_s: float, omega_rad_s: float) -> None:
        """Record the latest command to the robot."""
        self._speeds = v_m_s, omega_rad_s
        super().command(v_m_s, omega_rad_s)

    def lose(self) -> None:
        """A reading was lost, and with it the motion since the one before, unless the robot has not sent it."""
        self._gaps += 1
        self._known = False
        self._lost, self._lost_turn = copy(self._best), self._gyro_turn or 0.0

    def begin(self, now_ns: int) -> None:
        """The robot counts from now on: it has sent what was before, but that cannot be used."""
        self._measured, self._lost = copy(self._best), None
        self._gyro_turn, self._measured_ns = 0.0, now_ns

    def measure(self, distance_mm: int, angle_deg: int, now_ns: int) -> None:
        """Distance and angle since the last reading; impossible values count as lost."""
        half = 0.5 * CREATE_1.wheel_base_m * math.radians(angle_deg)
        left, right = distance_mm / 1000.0 - half, distance_mm / 1000.0 + half
        span_s = (now_ns - self._measured_ns) * 1e-9
        span_s = span_s if 0.0 <= span_s <= LONGEST_SPAN_S else LONGEST_SPAN_S  # also after the clock was set back
        if max(abs(left), abs(right)) > FASTEST_M_S * span_s + LATE_M:
            self.lose()
            self.begin(now_ns)
            return
        gyro_turn, self._gyro_turn, self._measured_ns = self._gyro_turn, 0.0, now_ns
        judged, lost_turn = self._check.step(now_ns, left, right, gyro_turn if self._known else None), 0.0
        if gyro_turn is not None and not self._known and self._checked.gyro:
            judged, lost_turn = judged._replace(turn_rad=gyro_turn), self._lost_turn  # the wheels' may lack a part
        self._checked = judged
        self._roll(left, right)
        self._measured = self._moved(distance_mm / 1000.0, judged.turn_rad, lost_turn)
        self._best, self._lost = copy(self._measured), None
        if not self._known:
            self._known, self._unsure_ns = True, now_ns

    def _moved(self, distance_m: float, turn_rad: float, lost_turn: float) -> PlanarPose:
        """The pose after a measured motion. After a loss the robot counts from there, or from the last reading if it
        has not sent what was lost: the end that is nearer to the dead reckoning is taken."""
        ends = [self._measured] if self._lost is None else [self._measured, self._lost]
        for end, turn in zip(ends, (turn_rad, turn_rad - lost_turn)):
            end.advance(distance_m * self._linear_scale, turn * self._angular_scale)
        return min(ends, key=lambda end: end.apart_m(self._best, CREATE_1.wheel_base_m))

    def reading(self, now_ns: int, gyro_rad_s: float | None = None) -> OdometryReading:
        """The pose now; gyro_rad_s is the measured rate where there is one."""
        if self._resets:
            self._restart()
        dt_s = _since(self._then_ns, now_ns)
        self._then_ns = now_ns
        self._check.listen(now_ns)
        v, omega = self._speeds
        if gyro_rad_s is None:
            self._gyro_turn = None
        else:
            if not self._check.can_turn(gyro_rad_s):
                self._strange_ns, gyro_rad_s = now_ns, omega
            if self._checked.gyro:
                omega = gyro_rad_s * self._angular_scale
            if self._gyro_turn is not None:
                self._gyro_turn += gyro_rad_s * dt_s
        for pose in (self._best, self._pose):
            pose.advance(v * dt_s, omega * dt_s)
        self._pose.approach(self._best, CORRECTION_M, CORRECTION_RAD)
        doubt = ""
        if 0 <= now_ns - self._strange_ns < WINDOW_NS:
            doubt = "the gyro turns as the base cannot; the heading is that of the wheels"
        elif not self._known or 0 <= now_ns - self._unsure_ns < WINDOW_NS:
            doubt = LOST
        return self._reading(now_ns, v, omega, doubt)


def _since(then_ns: int, now_ns: int) -> float:
    """Seconds to integrate over, at most 0.1: the motion in a longer pause is not known. 0 after the host's clock was
    set back."""
    return min(max(0.0, (now_ns - then_ns) * 1e-9), 0.1) if then_ns else 0.0


class BoardGyro:
    """Turns 10-bit counts into a rate and a heading; learns its zero while the wheels stand.

    A robot may be turned as steadily as it stands: on a turntable now, or in the hand when the zero was learned. So
    another zero is believed once as many samples in a row agree on it as on the present one."""

    def __init__(self) -> None:
        self.offset = self._other = 0.0
        self._samples = self._other_samples = 0
        self._heading_rad, self._then_ns = 0.0, 0

    def reading(self, counts: int, standing: bool, now_ns: int) -> GyroReading | None:
        """Heading and rate, or None where the rate is not known."""
        rate = self.rate_rad_s(counts, standing)
        dt_s = _since(self._then_ns, now_ns)
        self._then_ns = now_ns
        if rate is None:
            return None
        self._heading_rad += rate * dt_s
        return GyroReading(self._heading_rad, rate)

    def rate_rad_s(self, counts: int, standing: bool) -> float | None:
        """Counter-clockwise rate, or None while the zero is unknown."""
        if standing and HEALTHY_OFFSET[0] <= counts <= HEALTHY_OFFSET[1]:
            self._learn(counts)
        else:
            self._other_samples = 0
        if not self._samples:
            return None
        return -math.radians((counts - self.offset) / self.offset * RANGE_DEG_S * RANGE_FACTOR)

    def _learn(self, counts: int) -> None:
        if self._samples and abs(counts - self.offset) < STILL_COUNTS:
            self._other_samples = 0
            self._samples = min(self._samples + 1, MOST_SAMPLES)
            self.offset += (counts - self.offset) / self._samples
        else:
            self._other_samples = self._other_samples + 1 if abs(counts - self._other) < STILL_COUNTS else 1
            self._other += (counts - self._other) / self._other_samples
            if self._other_samples >= max(ENOUGH_SAMPLES, self._samples):
                self.offset, self._samples = self._other, self._other_samples


def counts_of(rate_rad_s: float) -> int:
    """The converter's value for a rate; saturates."""
    turned = math.degrees(rate_rad_s) / (RANGE_DEG_S * RANGE_FACTOR)
    return max(0, min(1023, round(_MIDDLE * (1.0 - turned))))
