"""One line that tells how a run is going: rewritten on a terminal, a plain line now and then otherwise."""

import shutil
import time
from collections.abc import Iterable
from typing import TextIO

from vsx_ros.ros.monitor import Monitor

_TERMINAL_PERIOD_S = 1.0
_PLAIN_PERIOD_S = 5.0


def progress_line(
    monitor: Monitor, coverage: float | None, elapsed_s: float, limit_s: float | None, missing: Iterable[str] = ()
) -> str:
    """State, coverage, keyframes, tracked ratio, distance, time, and the reason of the state. missing: nodes known to
    be without their device."""
    stats, status = monitor.stats, monitor.status
    area = monitor.grid.known_area_m2 if monitor.grid is not None else 0.0
    covered = f"{100 * coverage:.0f} % covered" if coverage is not None else f"{area:.1f} m2 known"
    clock = f"{elapsed_s:.0f}" + (f"/{limit_s:.0f} s" if limit_s is not None else " s")
    facts = [
        clock,
        str(status.get("state", "starting")),
        monitor.slam_state,
        covered,
        f"{stats.get('keyframes', 0):.0f} keyframes",
        f"{100 * stats.get('tracked_ratio', 0.0):.0f} % of points found at {stats.get('fps', 0.0):.0f} Hz",
        f"{monitor.distance_m:.1f} m",
    ]
    waiting = f"waiting for {' and '.join(missing) or 'the nodes'}"
    return " | ".join([*facts, str(status.get("reason", waiting))])


class Progress:
    """Writes to a terminal or a file, line by line."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._rewrites = self._out.isatty()
        self._shown_s = -1e9

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next line."""
        period_s = _TERMINAL_PERIOD_S if self._rewrites else _PLAIN_PERIOD_S
        return time.monotonic() - self._shown_s >= period_s

    def show(self, line: str) -> None:
        """Show the line, cut to the width of a terminal."""
        self._shown_s = time.monotonic()
        if self._rewrites:
            width = shutil.get_terminal_size().columns
            self._out.write(f"\r\x1b[K{line[: width - 1]}")
        else:
            self._out.write(line + "\n")
        self._out.flush()

    def say(self, line: str) -> None:
        """A line that stays."""
        self._out.write(f"\r\x1b[K{line}\n" if self._rewrites else line + "\n")
        self._out.flush()
