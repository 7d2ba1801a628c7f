"""The Kobuki's gyro: its heading, its raw samples, and whether it is alive.

Source: Yujin Robot, Kobuki "Serial Protocol" appendix, sub-payloads 4 and 13 (ST L3G4200D, 0.00875 deg/s a step,
mounted a quarter turn about the vertical).
"""

import math
from collections import deque

from vsx_hw.kobuki.protocol import GYRO_STEP_RAD, Feedback, RawGyro
from vsx_hw.odometry import signed
from vsx_hw.readings import GyroReading, RateSample

RAW_STEP_RAD_S = math.radians(0.00875)
SAMPLE_NS = 10_000_000
FRAMES = 25
"""Half a second. The sensor's noise of 0.03 deg/s per root of a hertz is twenty steps: samples that repeat for so
long are not measured."""
AGREES_RAD, AGREES_SHARE = 0.02, 0.2
"""What its angle and the sum of its samples may differ by in that time: a zero that is off by 1 deg/s, and the
scale."""


def gyro_reading(feedback: Feedback, stamp_ns: int, trusted: bool) -> GyroReading | None:
    """Sub-payloads 4 and 13 of a frame."""
    inertia, raw = feedback.inertia, feedback.gyro
    if inertia is None:
        return None
    heading, rate = (math.radians(value / 100.0) for value in inertia)
    return GyroReading(heading, rate, trusted, rates(raw, stamp_ns) if raw is not None else ())


def rates(raw: RawGyro, stamp_ns: int) -> tuple[RateSample, ...]:
    """Samples in the axes of the base, 10 ms apart, the newest at stamp_ns."""
    oldest_ns = stamp_ns - SAMPLE_NS * (len(raw.samples) - 1)
    return tuple(
        RateSample(oldest_ns + k * SAMPLE_NS, -RAW_STEP_RAD_S * y, RAW_STEP_RAD_S * x, RAW_STEP_RAD_S * z)
        for k, (x, y, z) in enumerate(raw.samples)
    )


class Pulse:
    """Whether the gyro is alive, by its own samples."""

    def __init__(self) -> None:
        self._frames: deque[tuple[tuple[tuple[int, int, int], ...], float, float]] = deque(maxlen=FRAMES)

    def alive(self, feedback: Feedback, turn_rad: float, dt_s: float) -> bool | None:
        """After one more frame, whose angle turned by turn_rad: True when its samples live and agree with its angle,
        False when they stand still, None when nobody knows."""
        if feedback.gyro is None or not feedback.gyro.samples:
            self._frames.clear()
            return None
        samples = feedback.gyro.samples
        mean = sum(z for _, _, z in samples) / len(samples)
        self._frames.append((samples, turn_rad, RAW_STEP_RAD_S * mean * dt_s))
        if len(self._frames) < FRAMES:
            return None
        if len({frame[0] for frame in self._frames}) == 1:
            return False
        angle = math.fsum(turn for _, turn, _ in self._frames)
        summed = math.fsum(turn for _, _, turn in self._frames)
        return True if abs(angle - summed) < AGREES_RAD + AGREES_SHARE * abs(summed) else None


def turned_rad(before: Feedback, after: Feedback) -> float | None:
    """By how much the angle turned between two frames; None where one of them has none."""
    if after.inertia is None or before.inertia is None:
        return None
    return GYRO_STEP_RAD * signed(after.inertia.angle_centideg - before.inertia.angle_centideg, 36000)
