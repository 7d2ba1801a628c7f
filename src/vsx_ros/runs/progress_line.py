"""The line that tells on a terminal how a run is going, live or in lock-step."""

from vsx_ros.exploration.decision import without_figures
from vsx_ros.exploration.time_left import whole_minutes

_WIDTH = 79  # characters: a terminal has 80, and the last one would break the line
_LEAST = 40  # of them for state and reason; facts give way
_CUT = "..."


def progress_line(
    state: str, reason: str, *, known: str, driven_m: float, elapsed_s: float, limit_s: float | None = None,
    left_s: float | None = None,
) -> str:  # fmt: skip
    """State and reason first, cut to fit; then what is known (words), the distance driven, the time, and the time left
    if that is known."""
    way, time = f"{driven_m:.1f} m", f"{elapsed_s:.0f}" + (f"/{limit_s:.0f} s" if limit_s is not None else " s")
    left = [] if left_s is None else [f"{time}, ~{max(1, whole_minutes(left_s))} min left"]
    why = ": ".join(filter(None, [state, without_figures(reason)]))
    tails = [" | " + " | ".join(facts) for facts in (*([known, way, last] for last in (*left, time)), [known, time])]
    tail = next((tail for tail in tails if len(tail) <= _WIDTH - min(len(why), _LEAST)), tails[-1])
    room = _WIDTH - len(tail)
    return (why if len(why) <= room else why[: room - len(_CUT)] + _CUT) + tail
