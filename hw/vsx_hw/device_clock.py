"""From a device's own clock to host time, by the least delay ever seen.

A device stamps evenly; the arrival on the host is late by a varying amount (USB scheduling, a busy machine). The
smallest difference arrival - device time of the last seconds is the best estimate of the clocks' offset. Windows follow
the drift between the two crystals.
"""

from collections import deque

WINDOW_NS = 10_000_000_000  # in which quartzes drift apart by a millisecond at most
RESTART_NS = 1_000_000_000  # no delay of a message is so long


class DeviceClock:
    """Unwraps a counter of tick_hz that restarts at 2**bits, and places it on the host's time axis."""

    def __init__(self, tick_hz: int, bits: int) -> None:
        self._tick_hz = tick_hz
        self._modulus = 1 << bits
        self._raw: int | None = None
        self._ticks = self._arrival_ns = self._window_start_ns = self._last_ns = 0
        self._least_ns: deque[int] = deque(maxlen=2)  # offset in this window and in the one before

    def host_ns(self, raw: int, arrival_ns: int) -> int:
        """Host time of the counter value raw that arrived at arrival_ns; strictly increasing between restarts.

        A jump against the host's clock of more than a second (the device restarted, was silent for long, or the host's
        clock was set) starts anew.
        """
        ticks = 0 if self._raw is None else (raw - self._raw) % self._modulus
        jump_ns = arrival_ns - self._arrival_ns - self._ns(ticks)
        if self._raw is None or abs(jump_ns) > RESTART_NS:
            self._least_ns.clear()
            self._ticks, self._last_ns = raw, 0
        else:
            self._ticks += ticks
        self._raw, self._arrival_ns = raw, arrival_ns
        offset_ns = arrival_ns - self._ns(self._ticks)
        if not self._least_ns or arrival_ns - self._window_start_ns > WINDOW_NS:
            self._least_ns.append(offset_ns)
            self._window_start_ns = arrival_ns
        else:
            self._least_ns[-1] = min(self._least_ns[-1], offset_ns)
        self._last_ns = max(self._last_ns + 1, self._ns(self._ticks) + min(self._least_ns))
        return self._last_ns

    def _ns(self, ticks: int) -> int:
        return ticks * 1_000_000_000 // self._tick_hz
