"""Extracts Kobuki frames from a byte stream: complete, documented, and possible after the previous one.

The XOR byte does not detect two changed bits in the same column. So a frame must have the structure of the previous
one, and its values must be reachable from there in the elapsed time."""

from typing import NamedTuple

from vsx_hw.kobuki.feedback import METRES_PER_TICK, Feedback, decode
from vsx_hw.kobuki.protocol import FrameScanner
from vsx_hw.odometry import signed

USUAL_MS, LONGEST_MS = (10, 40), 500
"""Time between two frames (20 ms), and the longest time over which frames are compared after losses."""
MOST_TICKS_PER_MS = 10  # 0.85 m/s; the base drives 0.7
MOST_CENTIDEG_PER_MS = 25  # 250 deg/s, where the gyro saturates; the base turns by 180
MOST_DECIVOLT = 5  # from one frame to the next


class _Received(NamedTuple):
    """A frame, its arrival time, and the numbers of refused frames and skipped bytes until then."""

    feedback: Feedback
    time_ns: int
    refused: int
    skipped_bytes: int


class StreamParser:
    """Turns the byte stream into Feedback frames; recovers after lost, added or changed bytes.

    A frame is accepted when it can follow the last accepted one, or the one refused just before it. So switching the
    base off and on costs one frame; a base whose clock stands or jumps counts as silent. ``refused`` counts frames with
    a correct checksum that were not accepted."""

    def __init__(self) -> None:
        self.frames = 0
        self.refused = 0
        self._scanner = FrameScanner()
        self.restart()

    def restart(self) -> None:
        """Start a new connection without earlier frames; the counters continue."""
        self._scanner.clear()
        self._last: _Received | None = None
        self._doubted: _Received | None = None

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._scanner.skipped_bytes

    @property
    def doubts(self) -> bool:
        """Whether the latest complete frame could not follow the earlier ones."""
        return self._doubted is not None

    def feed(self, data: bytes, now_ns: int = 0) -> list[Feedback]:
        """The frames completed by these bytes, in order. now_ns: arrival time, if known."""
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
        heard = _Received(feedback, now_ns, self.refused, self.skipped_bytes)
        earlier = [before for before in (self._last, self._doubted) if before is not None]
        if earlier and not any(_follows(before, heard) for before in earlier):
            self._doubted = heard._replace(refused=self.refused + 1)
            return False
        self._last, self._doubted = heard, None
        return True


def _follows(heard_before: _Received, heard_after: _Received) -> bool:
    """Whether a base can have sent the second frame after the first. If no bytes were skipped in between, the number of
    frames in between is known. Changes that people make (buttons, charger) are accepted in their second frame."""
    before, after = heard_before.feedback, heard_after.feedback
    a, b = before.core, after.core
    dt_ms = (b.time_ms - a.time_ms) % 0x10000
    longest_ms = (1 + heard_after.refused - heard_before.refused) * USUAL_MS[1]
    whole = heard_before.skipped_bytes == heard_after.skipped_bytes
    known = whole and heard_after.time_ns - heard_before.time_ns <= longest_ms * 1_000_000
    shortest_ms, longest_ms = (USUAL_MS[0], longest_ms) if known else (1, LONGEST_MS)
    if not shortest_ms <= dt_ms <= longest_ms or before.regular_parts != after.regular_parts:
        return False
    steady = (a.buttons, a.charger) == (b.buttons, b.charger)
    if not steady or abs(b.battery_decivolt - a.battery_decivolt) > MOST_DECIVOLT or rolled_m(before, after) is None:
        return False
    if before.inertia is None or after.inertia is None:
        return True
    turned = signed(after.inertia.angle_centideg - before.inertia.angle_centideg, 36000)
    return abs(turned) <= MOST_CENTIDEG_PER_MS * dt_ms


def rolled_m(before: Feedback, after: Feedback) -> tuple[float, float] | None:
    """Distances of the left and right wheel between two frames, or None when the base cannot have driven them."""
    a, b = before.core, after.core
    dt_ms = (b.time_ms - a.time_ms) % 0x10000
    left, right = signed(b.left_ticks - a.left_ticks, 0x10000), signed(b.right_ticks - a.right_ticks, 0x10000)
    if not 0 < dt_ms <= LONGEST_MS or max(abs(left), abs(right)) > MOST_TICKS_PER_MS * dt_ms:
        return None
    return METRES_PER_TICK * left, METRES_PER_TICK * right
