"""The gyro of the TurtleBot 1's power board: one analog axis on the Create's cargo bay input (packet 33).

Sources: Analog Devices ADXRS613 data sheet (12.5 mV per deg/s about 2.5 V, 150 deg/s); the factor 1.35 is the one that
the TurtleBot's own driver calibrates with (0.395 deg/s a count; the data sheet alone gives 0.391).
"""

import math

RANGE_DEG_S = 150.0
RANGE_FACTOR = 1.35
ENOUGH_SAMPLES, MOST_SAMPLES = 50, 1000
HEALTHY_OFFSET = (425.0, 575.0)
STILL_COUNTS = 8.0
"""Three deg/s: a robot that is told to stand but turns faster is being carried; its samples are no offset."""


class BoardGyro:
    """Turns 10-bit counts into a rate; learns its zero while the wheels stand."""

    def __init__(self) -> None:
        self.offset = 0.0
        self._samples = 0

    def rate_rad_s(self, counts: int, standing: bool) -> float | None:
        """Counter-clockwise rate, or None while the zero is unknown or outside of 425..575: the board is unpowered."""
        learned = self._samples >= ENOUGH_SAMPLES
        if standing and (not learned or abs(counts - self.offset) < STILL_COUNTS):
            self._samples = min(self._samples + 1, MOST_SAMPLES)
            self.offset += (counts - self.offset) / self._samples
        if not learned or not HEALTHY_OFFSET[0] <= self.offset <= HEALTHY_OFFSET[1]:
            return None
        return -math.radians((counts - self.offset) / self.offset * RANGE_DEG_S * RANGE_FACTOR)


def counts_of(rate_rad_s: float, offset: float = 512.0) -> int:
    """What the converter shows for a rate; saturates."""
    turned = math.degrees(rate_rad_s) / (RANGE_DEG_S * RANGE_FACTOR)
    return max(0, min(1023, round(offset * (1.0 - turned))))
