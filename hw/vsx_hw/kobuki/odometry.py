"""Where the Kobuki is, from its encoders and its gyro."""

from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.gyro import Pulse, turned_rad
from vsx_hw.kobuki.protocol import Feedback
from vsx_hw.kobuki.stream import rolled_m
from vsx_hw.odometry import WheelOdometry
from vsx_hw.plausibility import PERIOD_NS, MotionCheck
from vsx_hw.readings import OdometryReading

SHORT_GAP_MS = 60
"""Over so much, a refused frame or two, the gyro tells the turn although the counters jumped."""
LOST_FRAMES = 50
"""After a gap the pose is uncertain for a second."""


class KobukiOdometry(WheelOdometry):
    """Integrates feedback frames. Distance comes from the encoders, heading from the gyro where the frame has it and
    the ``MotionCheck`` believes it, else from the encoders.

    After a gap, a power cycle or an impossible step the counters are taken as a new base line: the pose stays
    continuous and ``gaps`` counts the loss.
    """

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        super().__init__(MotionCheck(WHEEL_BASE_M), linear_scale, angular_scale)
        self._previous: Feedback | None = None
        self._pulse = Pulse()
        self._time_ns = 0  # of the base's own clock, counted on over gaps
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
        """Count the motion between two frames; its speeds."""
        dt_ms = (after.core.time_ms - before.core.time_ms) % 0x10000
        rolled = rolled_m(before, after)
        if rolled is None:
            self._gaps += 1
            self._since_gap = 0
            self._time_ns += PERIOD_NS
            self._pose.advance(0.0, self._turned_unrolled(before, after, dt_ms))
            self._checked = self._check.step(self._time_ns, 0.0, 0.0)
            return 0.0, 0.0
        self._since_gap += 1
        self._time_ns += dt_ms * 1_000_000
        left, right = rolled
        dt_s, turned = dt_ms / 1000.0, turned_rad(before, after)
        alive = None if turned is None else self._pulse.alive(after, turned, dt_s)
        self._checked = self._check.step(self._time_ns, left, right, turned, alive)
        self._roll(left, right)
        distance, turn = 0.5 * (left + right) * self._linear_scale, self._checked.turn_rad * self._angular_scale
        self._pose.advance(distance, turn)
        return distance / dt_s, turn / dt_s

    def _turned_unrolled(self, before: Feedback, after: Feedback, dt_ms: int) -> float:
        """The turn by the gyro while the counters jumped: two frames of a turn of 1.5 rad/s are worth 3.4 degrees."""
        turned = turned_rad(before, after)
        known = self._checked.gyro and turned is not None and 0 < dt_ms <= SHORT_GAP_MS
        if turned is None or not known or not self._check.can_turn(1000.0 * turned / dt_ms):
            return 0.0
        return turned * self._angular_scale
