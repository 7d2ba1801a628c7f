"""Kobuki frames out of a stream of bytes: those that are whole, documented, and possible after the one before.

One XOR byte lets a frame through when two bits of the same column were changed. So the structure must be that of the
frame before, and its values must be reachable from there in the time that passed.
"""

from __future__ import annotations

from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.framing import FrameScanner
from vsx_hw.kobuki.protocol import GYRO_STEP_RAD, METRES_PER_TICK, Feedback, decode

USUAL_MS, LONGEST_MS = (10, 40), 500
"""From one frame to the next (20 ms), and the longest time that is compared over when frames were lost."""
MOST_TICKS_PER_MS = 10
"""0.85 m/s; the base drives 0.7."""
MOST_CENTIDEG_PER_MS = 25
"""250 deg/s, where the gyro saturates; the base turns by 180."""
MOST_SLIP_RAD_PER_MS = 0.002
"""Between the turn by the wheels and that by the gyro; a wheel that spins free at 0.4 m/s."""
MOST_DECIVOLT = 5


class StreamParser:
    """Turns the byte stream into Feedback frames; recovers after lost, added or changed bytes.

    A frame that cannot follow the one before is refused once: the next one counts whatever it says, so that a base that
    was switched off and on costs one frame. A frame with the time of the one before is refused always: it is an echo.
    ``refused`` counts frames with a right checksum that failed.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.refused = 0
        self._scanner = FrameScanner()
        self._last: Feedback | None = None
        self._damage, self._heard_ns = (0, 0), 0
        self._doubted = False

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._scanner.skipped_bytes

    def feed(self, data: bytes, now_ns: int = 0) -> list[Feedback]:
        """The frames completed by these bytes, in order. now_ns: when they came, if that is known."""
        found = []
        for payload in self._scanner.feed(data):
            feedback = decode(payload)
            if feedback is None or not self._believes(feedback, now_ns):
                self.refused += 1
            else:
                self.frames += 1
                found.append(feedback)
        return found

    def _believes(self, feedback: Feedback, now_ns: int) -> bool:
        last, damage = self._last, (self.refused, self.skipped_bytes)
        if last is not None:
            if feedback.core.time_ms == last.core.time_ms:
                return False
            at_once = damage == self._damage and now_ns - self._heard_ns <= USUAL_MS[1] * 1_000_000
            if not self._doubted and not follows(last, feedback, at_once):
                self._doubted = True
                return False
        self._last, self._damage, self._heard_ns, self._doubted = feedback, damage, now_ns, False
        return True


def follows(before: Feedback, after: Feedback, at_once: bool) -> bool:
    """Whether a base can have sent this frame after that one; at_once: nothing was lost between them.

    What only people change (buttons, charger) counts from its second frame on.
    """
    a, b = before.core, after.core
    dt_ms = (b.time_ms - a.time_ms) % 0x10000
    shortest, longest = USUAL_MS if at_once else (1, LONGEST_MS)
    if not shortest <= dt_ms <= longest or before.regular_parts != after.regular_parts:
        return False
    steady = (a.buttons, a.charger) == (b.buttons, b.charger)
    left, right = signed(b.left_ticks - a.left_ticks, 0x10000), signed(b.right_ticks - a.right_ticks, 0x10000)
    if not steady or abs(b.battery_decivolt - a.battery_decivolt) > MOST_DECIVOLT:
        return False
    if max(abs(left), abs(right)) > MOST_TICKS_PER_MS * dt_ms:
        return False
    if before.inertia is None or after.inertia is None:
        return True
    turned = signed(after.inertia.angle_centideg - before.inertia.angle_centideg, 36000)
    slip_rad = METRES_PER_TICK * (right - left) / WHEEL_BASE_M - GYRO_STEP_RAD * turned
    return abs(turned) <= MOST_CENTIDEG_PER_MS * dt_ms and abs(slip_rad) <= MOST_SLIP_RAD_PER_MS * dt_ms


def signed(difference: int, modulus: int) -> int:
    """The smallest step of a wrapping counter, in [-modulus/2, modulus/2)."""
    half = modulus // 2
    return (difference + half) % modulus - half
