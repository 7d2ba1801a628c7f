"""Where the Kobuki is, from its encoders and its gyro."""

from __future__ import annotations

import math

from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.protocol import GYRO_STEP_RAD, METRES_PER_TICK, Feedback
from vsx_hw.kobuki.stream import signed
from vsx_hw.readings import OdometryReading

LONGEST_GAP_MS = 500
FASTEST_M_S = 1.5
"""Twice the base's top speed: a faster pair of counts is a power cycle or a damaged frame, not motion."""


class KobukiOdometry:
    """Integrates feedback frames. Distance comes from the encoders, heading from the gyro where the frame has it.

    linear_scale and angular_scale correct the travelled distance and the measured turn (1.0 = as built).
    After a gap, a power cycle or an impossible step the counters are taken as a new base line: the pose stays
    continuous and ``gaps`` counts the loss.
    """

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        self._linear_scale = linear_scale
        self._angular_scale = angular_scale
        self._previous: Feedback | None = None
        self._pose = (0.0, 0.0, 0.0)
        self._wheels = (0.0, 0.0)
        self._gaps = 0

    def reset(self) -> None:
        """Start again at the origin; the counters' base line stays, so the next report is continuous."""
        self._pose = (0.0, 0.0, 0.0)

    def update(self, feedback: Feedback, stamp_ns: int) -> OdometryReading:
        """The reading after one more frame."""
        v = omega = 0.0
        if self._previous is not None:
            motion = self._motion(self._previous, feedback)
            if motion is None:
                self._gaps += 1
            else:
                distance, turn, dt_s = motion
                self._advance(distance, turn)
                v, omega = distance / dt_s, turn / dt_s
        self._previous = feedback
        x, y, heading = self._pose
        return OdometryReading(stamp_ns, x, y, heading, v, omega, self._gaps, True, self._wheels)

    def _motion(self, before: Feedback, after: Feedback) -> tuple[float, float, float] | None:
        """(distance [m], turn [rad], duration [s]) between two frames, or None where it cannot be known."""
        dt_ms = (after.core.time_ms - before.core.time_ms) % 0x10000
        if not 0 < dt_ms <= LONGEST_GAP_MS:
            return None
        left = METRES_PER_TICK * signed(after.core.left_ticks - before.core.left_ticks, 0x10000)
        right = METRES_PER_TICK * signed(after.core.right_ticks - before.core.right_ticks, 0x10000)
        if max(abs(left), abs(right)) > FASTEST_M_S * max(dt_ms, 20) / 1000.0:
            return None
        self._wheels = (self._wheels[0] + left, self._wheels[1] + right)
        turn = (right - left) / WHEEL_BASE_M
        if after.inertia is not None and before.inertia is not None:
            turn = GYRO_STEP_RAD * signed(after.inertia.angle_centideg - before.inertia.angle_centideg, 36000)
        return 0.5 * (left + right) * self._linear_scale, turn * self._angular_scale, dt_ms / 1000.0

    def _advance(self, distance: float, turn: float) -> None:
        """Along the arc, exactly."""
        x, y, heading = self._pose
        chord = distance if abs(turn) < 1e-9 else distance * math.sin(0.5 * turn) / (0.5 * turn)
        mean = heading + 0.5 * turn
        self._pose = (x + chord * math.cos(mean), y + chord * math.sin(mean), heading + turn)
