"""How a test waits: as long as it takes. How late a busy machine is."""

import itertools
import threading
import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

PATIENCE_S = 400.0
"""Below the time limit of a test (pyproject.toml), so that a test that waits in vain says for what."""


class Lateness:
    """Measures how long this machine keeps threads waiting. A limit on a time is a limit for a machine that runs every
    thread at once; a busy one may exceed it by so much."""

    _TICK_S = 0.01

    def __init__(self) -> None:
        self._due_s = [time.monotonic() + self._TICK_S]
        self._woken_s: list[float] = []  # one for each of those that is over
        self._closed = False
        threading.Thread(target=self._measure, daemon=True).start()

    def since(self, began_s: float) -> float:
        """Sum of the delays from then until now [s]; began_s: of time.monotonic()."""
        return self.between(began_s, time.monotonic())

    def between(self, began_s: float, ended_s: float) -> float:
        """Sum of the delays in this time [s], with one that lasts; both of time.monotonic(), until now."""
        waits = itertools.zip_longest(self._due_s, self._woken_s, fillvalue=time.monotonic())
        return sum(max(0.0, min(woken_s, ended_s) - max(due_s, began_s)) for due_s, woken_s in waits)

    def close(self) -> None:
        """End the measuring."""
        self._closed = True

    def _measure(self) -> None:
        while not self._closed:
            time.sleep(max(0.0, self._due_s[-1] - time.monotonic()))
            woken_s = time.monotonic()
            self._woken_s.append(woken_s)
            self._due_s.append(woken_s + self._TICK_S)
        self._due_s.pop()


def wait_for(
    condition: Callable[[], T], what: str = "", told: Callable[[], object] = str, pause_s: float = 0.01,
    within_s: float | None = None,
) -> T:  # fmt: skip
    """The first true value of the condition. The limit is for a program that hangs, not for a machine that is busy.
    told: what to show when that has happened. within_s: how soon it must come, on a machine that runs every thread at
    once."""
    began_s, lateness = time.monotonic(), Lateness() if within_s is not None else None
    while not (value := condition()):
        assert time.monotonic() < began_s + PATIENCE_S, f"waited in vain for {what or condition}: {told()}"
        time.sleep(pause_s)
    if within_s is not None and lateness is not None:
        took_s, late_s = time.monotonic() - began_s, lateness.since(began_s)
        lateness.close()
        assert took_s <= within_s + late_s, f"{what} took {took_s:.1f} s, of which {late_s:.1f} s are the machine's"
    return value
