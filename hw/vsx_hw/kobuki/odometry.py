"""The Kobuki's pose from its encoders and gyro, and a check that the gyro is alive.

Source: Yujin Robot, Kobuki "Serial Protocol" appendix, sub-payloads 4 and 13 (ST L3G4200D, 0.00875 deg/s per step,
mounted a quarter turn about the vertical)."""

import math
from collections import deque

from vsx_hw.kobuki.feedback import GYRO_STEP_RAD, Feedback
from vsx_hw.kobuki.protocol import WHEEL_BASE_M
from vsx_hw.kobuki.stream import rolled_m
from vsx_hw.odometry import WheelOdometry, signed
from vsx_hw.plausibility import PERIOD_NS, MotionCheck
from vsx_hw.readings import GyroReading, OdometryReading, RateSample

SHORT_GAP_MS = 60  # Over one or two refused frames the gyro still gives the turn when the counters jumped
LOST_FRAMES = 50  # After a gap the pose is uncertain for a second

RAW_STEP_RAD_S = math.radians(0.00875)  # of L3G4200D at 250 deg/s (data sheet)
SAMPLE_NS = 10_000_000  # 100 samples a second
FRAMES = 25
"""Half a second. The sensor's noise of 0.03 deg/s/sqrt(Hz) is twenty steps: samples that repeat for so long are not
measured."""
AGREES_RAD, AGREES_SHARE = 0.02, 0.2
"""Largest difference of the gyro's angle and the sum of its samples in that time: a zero error of 1 deg/s, and the
scale."""


def gyro_reading(feedback: Feedback, stamp_ns: int, trusted: bool) -> GyroReading | None:
    """Heading, rate and raw samples of a frame. Samples are in the axes of the base, 10 ms apart, the newest at
    stamp_ns."""
    if feedback.inertia is None:
        return None
    heading, rate = (math.radians(value / 100.0) for value in feedback.inertia)
    samples = feedback.gyro.samples if feedback.gyro is not None else ()
    oldest_ns = stamp_ns - SAMPLE_NS * (len(samples) - 1)
    raw = (
        RateSample(oldest_ns + k * SAMPLE_NS, -RAW_STEP_RAD_S * y, RAW_STEP_RAD_S * x, RAW_STEP_RAD_S * z)
        for k, (x, y, z) in enumerate(samples)
    )
    return GyroReading(heading, rate, trusted, tuple(raw))


class Pulse:
    """Judges from the gyro's own samples whether it is alive."""

    def __init__(self) -> None:
        self._frames: deque[tuple[tuple[tuple[int, int, int], ...], float, float]] = deque(maxlen=FRAMES)

    def alive(self, feedback: Feedback, turn_rad: float, dt_s: float) -> bool | None:
        """Take one more frame, whose angle turned by turn_rad. True when the samples vary and agree with the angle,
        False when they repeat, None when it is not known."""
        if feedback.gyro is None or not feedback.gyro.samples:
            self._frames.clear()
            return None
        samples = feedback.gyro.samples
        mean = sum(z for _, _, z in samples) / len(samples)
        self._frames.append((samples, turn_rad, RAW_STEP_RAD_S * mean * dt_s))
        if len(self._frames) < FRAMES:
            return None
        repeated, angles, sums = zip(*self._frames)
        if len(set(repeated)) == 1:
            return False
        angle, summed = math.fsum(angles), math.fsum(sums)
        return True if abs(angle - summed) < AGREES_RAD + AGREES_SHARE * abs(summed) else None


class KobukiOdometry(WheelOdometry):
    """Integrates feedback frames. Distance comes from the encoders. Heading comes from the gyro if the frame has it and
    the ``MotionCheck`` trusts it, else from the encoders.

    After a gap, a power cycle or an impossible step the counters are the new reference: the pose stays continuous and
    ``gaps`` counts the loss."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(MotionCheck(WHEEL_BASE_M), linear_scale, angular_scale)
        self._previous: Feedback | None = None
        self._pulse = Pulse()
        self._time_ns = 0  # of the base's own clock, continued over gaps
        self._since_gap = LOST_FRAMES

    def update(self, feedback: Feedback, stamp_ns: int) -> OdometryReading:
        """The reading after one more frame."""
        v = omega = 0.0
        if self._previous is not None:
            v, omega = self._move(self._previous, feedback)
        self._previous = feedback
        lost = "clock or counters of the base jumped: its motion is not known"
        return self._reading(stamp_ns, v, omega, lost if self._since_gap < LOST_FRAMES else "")

    def _move(self, before: Feedback, after: Feedback) -> tuple[float, float]:
        """Integrate the motion between two frames; returns (v, omega)."""
        dt_ms = (after.core.time_ms - before.core.time_ms) % 0x10000
        rolled, turned = rolled_m(before, after), None
        if before.inertia is not None and after.inertia is not None:
            turned = GYRO_STEP_RAD * signed(after.inertia.angle_centideg - before.inertia.angle_centideg, 36000)
        if rolled is None:
            self._gaps += 1
            self._since_gap = 0
            self._time_ns += PERIOD_NS
            if turned is not None and self._is_turn_known(turned, dt_ms):
                self._pose.advance(0.0, turned * self._angular_scale)
            self._checked = self._check.step(self._time_ns, 0.0, 0.0)
            return 0.0, 0.0
        self._since_gap += 1
        self._time_ns += dt_ms * 1_000_000
        left, right = rolled
        dt_s = dt_ms / 1000.0
        alive = None if turned is None else self._pulse.alive(after, turned, dt_s)
        self._checked = self._check.step(self._time_ns, left, right, turned, alive)
        self._roll(left, right)
        distance, turn = 0.5 * (left + right) * self._linear_scale, self._checked.turn_rad * self._angular_scale
        self._pose.advance(distance, turn)
        return distance / dt_s, turn / dt_s

    def _is_turn_known(self, turned_rad: float, dt_ms: int) -> bool:
        """Whether to use the gyro although the counters jumped: two frames at 1.5 rad/s are 3.4 degrees."""
        return self._checked.gyro and 0 < dt_ms <= SHORT_GAP_MS and self._check.can_turn(1000.0 * turned_rad / dt_ms)
