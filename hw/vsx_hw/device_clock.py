"""From a device's own clock to host time, by the least delay ever seen.

A device stamps evenly; the arrival on the host is late by a varying amount (USB scheduling, a busy machine). The
smallest difference arrival - device time of the last seconds is the best estimate of the clocks' offset. Windows follow
the drift between the two crystals.
"""

WINDOW_NS = 10_000_000_000
RESTART_NS = 1_000_000_000


class DeviceClock:
    """Unwraps a counter of tick_hz that restarts at 2**bits, and places it on the host's time axis."""

    def __init__(self, tick_hz: int, bits: int) -> None:
        self._tick_hz = tick_hz
        self._modulus = 1 << bits
        self._ticks = 0
        self._raw = -1
        self._arrival_ns = 0
        self._window_start_ns = 0
        self._least_ns: list[int] = []
        self._last_ns = 0

    def host_ns(self, raw: int, arrival_ns: int) -> int:
        """Host time of the counter value raw that arrived at arrival_ns; strictly increasing between restarts.

        A jump against the host's clock of more than a second (the device restarted, was silent for long, or the host's
        clock was set) starts anew.
        """
        if self._raw < 0 or self._jumped(raw, arrival_ns):
            self._least_ns = []
            self._window_start_ns = arrival_ns
            self._ticks = raw
            self._last_ns = 0
        else:
            self._ticks += (raw - self._raw) % self._modulus
        self._raw, self._arrival_ns = raw, arrival_ns
        device_ns = self._ticks * 1_000_000_000 // self._tick_hz
        self._observe(arrival_ns - device_ns, arrival_ns)
        self._last_ns = max(self._last_ns + 1, device_ns + min(self._least_ns))
        return self._last_ns

    def _jumped(self, raw: int, arrival_ns: int) -> bool:
        step_ns = (raw - self._raw) % self._modulus * 1_000_000_000 // self._tick_hz
        return abs(arrival_ns - self._arrival_ns - step_ns) > RESTART_NS

    def _observe(self, offset_ns: int, arrival_ns: int) -> None:
        """Keep the least offset of this window and of the one before."""
        if not self._least_ns:
            self._least_ns = [offset_ns]
        elif arrival_ns - self._window_start_ns > WINDOW_NS:
            self._least_ns = [self._least_ns[-1], offset_ns]
            self._window_start_ns = arrival_ns
        else:
            self._least_ns[-1] = min(self._least_ns[-1], offset_ns)
