"""The sleep of the machine (suspend, a closed lid): whether it has slept.

A base goes on with its last command while the machine sleeps. The monotonic clock stands meanwhile, so afterwards what
was said before still looks fresh."""

import time
from collections.abc import Callable

from vsx_hw.readings import ahead_of_monotonic_ns

LEAST_NS = 20_000_000  # more than reading two clocks takes on a busy machine, less than any sleep


def asleep_ns() -> int:
    """How long the machine has slept since it was started."""
    return ahead_of_monotonic_ns(lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME))


class SleepWatch:
    """Notices that the machine has slept. clock_ns: as ``asleep_ns``."""

    def __init__(self, clock_ns: Callable[[], int] = asleep_ns) -> None:
        self._clock_ns = clock_ns
        self._known_ns = clock_ns()

    def slept_s(self) -> float:
        """How long it slept since the last call; 0 if it did not."""
        before_ns, self._known_ns = self._known_ns, self._clock_ns()
        slept_ns = self._known_ns - before_ns
        return slept_ns * 1e-9 if slept_ns >= LEAST_NS else 0.0
