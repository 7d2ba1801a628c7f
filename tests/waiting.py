"""How a test waits: as long as it takes. How late a busy machine is."""

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
        self._late: list[tuple[float, float]] = []
        self._closed = False
        threading.Thread(target=self._measure, daemon=True).start()

    def since(self, began_s: float) -> float:
        """Sum of the delays since then [s]; began_s: of time.monotonic()."""
        return sum(late_s for woken_s, late_s in self._late if woken_s >= began_s)

    def close(self) -> None:
        """End the measuring."""
        self._closed = True

    def _measure(self) -> None:
        while not self._closed:
            began_s = time.monotonic()
            time.sleep(self._TICK_S)
            woken_s = time.monotonic()
            self._late.append((woken_s, woken_s - began_s - self._TICK_S))


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
