"""The line that tells on a terminal how a live run is going."""

from collections.abc import Iterable

from vsx_ros.exploration.decision import without_figures
from vsx_ros.ros.monitor import Monitor

_WIDTH = 79  # characters: a terminal has 80, and the last one would break the line
_CUT = "..."


def progress_line(
    monitor: Monitor, coverage: float | None, elapsed_s: float, limit_s: float | None, missing: Iterable[str] = ()
) -> str:
    """State and reason first, cut to fit; then what is known, the distance driven, the time, and the time left if that
    is known. missing: nodes that are known to lack their device."""
    status = monitor.status
    area = monitor.grid.known_area_m2 if monitor.grid is not None else 0.0
    covered = f"{100 * coverage:.0f} % covered" if coverage is not None else f"{area:.1f} m2 known"
    time = f"{elapsed_s:.0f}" + (f"/{limit_s:.0f} s" if limit_s is not None else " s")
    left_s = status.get("left_s")
    left = "" if left_s is None else f", ~{max(1, round(left_s / 60.0))} min left"
    facts = f" | {covered} | {monitor.distance_m:.1f} m | {time}{left}"
    waiting = f"waiting for {' and '.join(missing) or 'the nodes'}"
    reason = f"{status.get('state', 'starting')}: {without_figures(str(status.get('reason', waiting)))}"
    room = _WIDTH - len(facts)
    return (reason if len(reason) <= room else reason[: room - len(_CUT)] + _CUT) + facts
