"""How long an exploration will still take: an estimate that is told only where it has proven right.

What is left to see, divided by the rate at which ground became known lately. It is wrong as long as each view shows
that more ground lies behind. So every estimate is kept, and the present one counts only if the earlier ones, as seen
from now, were right within 30 %."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.exploration.utility import View

RATE_S = 90.0  # over which the rate is taken: several views
_LONGEST_GAP_S = 60.0  # between two choices; what lasts longer was a pause
_RIGHT_WITHIN = 0.3  # share of the truth
_PROVEN_S = 60.0, 300.0  # an estimate must be right for as long as it says, within these bounds
_LEAST_CHOICES = 4  # in that time
_KEPT = 500


class Progress(NamedTuple):
    """When a view was chosen. at_s: time of exploring. known_m2: known ground. left_m2: unknown ground that the views
    left would show. estimate_s: the estimate made then; None without a rate."""

    at_s: float
    known_m2: float
    left_m2: float
    estimate_s: float | None


def left_to_see(views: Sequence[View], range_m: float) -> float:
    """The unknown ground [m2] that views would show together: of views that look at the same place only the one with
    the most counts. range_m: of the camera."""
    total_m2, centres = 0.0, np.zeros((0, 2))
    for view in sorted(views, key=lambda view: -view.gain_m2):
        centre = view.ahead(0.5 * range_m)
        if not len(centres) or np.hypot(*(centres - centre).T).min() > 0.5 * range_m:
            total_m2 += view.gain_m2
            centres = np.vstack([centres, centre])
    return total_m2


def estimate(history: Sequence[Progress], at_s: float, known_m2: float, left_m2: float) -> float | None:
    """The time left [s] by the rate of the last ``RATE_S``; None before there is one."""
    recent = [progress for progress in history if progress.at_s >= at_s - RATE_S]
    if not recent or at_s - recent[0].at_s < 0.5 * RATE_S:
        return None
    rate_m2_s = (known_m2 - recent[0].known_m2) / (at_s - recent[0].at_s)
    return left_m2 / rate_m2_s if rate_m2_s > 0.0 else None


def proven(history: Sequence[Progress]) -> float | None:
    """The newest estimate [s], if those before it, for about as long as it says, were right within 30 %, given that it
    is right itself; else None."""
    if not history or (now := history[-1]).estimate_s is None:
        return None
    span_s = min(max(now.estimate_s, _PROVEN_S[0]), _PROVEN_S[1])
    before = [progress for progress in history[:-1] if progress.at_s >= now.at_s - span_s]
    if now.at_s - history[0].at_s < span_s or len(before) < _LEAST_CHOICES:
        return None
    truth_s = np.array([now.at_s - progress.at_s + now.estimate_s for progress in before])
    told_s = np.array([np.inf if p.estimate_s is None else p.estimate_s for p in before])
    return now.estimate_s if bool(np.all(np.abs(told_s - truth_s) <= _RIGHT_WITHIN * truth_s)) else None


class TimeLeft:
    """Call ``add`` with every choice of a view. Pauses do not count."""

    def __init__(self) -> None:
        self._history: list[Progress] = []
        self._last_ns = 0

    def add(self, now_ns: int, known_m2: float, left_m2: float) -> None:
        """A view was chosen. known_m2: known ground. left_m2: as of ``left_to_see``."""
        history = self._history
        at_s = history[-1].at_s + min(1e-9 * (now_ns - self._last_ns), _LONGEST_GAP_S) if history else 0.0
        history.append(Progress(at_s, known_m2, left_m2, estimate(history, at_s, known_m2, left_m2)))
        self._last_ns = now_ns
        del history[:-_KEPT]

    def at(self, now_ns: int) -> float | None:
        """The time left [s]; None while it is not proven, or when no view has been chosen for a minute."""
        since_s, left_s = 1e-9 * (now_ns - self._last_ns), proven(self._history)
        return None if left_s is None or since_s > _LONGEST_GAP_S else max(left_s - since_s, 0.0)


def whole_minutes(seconds: float) -> int:
    """Half a minute counts as one, also in the live view (``status.js``)."""
    return math.floor(seconds / 60.0 + 0.5)


def left_words(left_s: float | None) -> str:
    """The time in words; empty if unknown."""
    if left_s is None:
        return ""
    minutes = whole_minutes(left_s)
    return "less than a minute left" if left_s < 45.0 else f"about {minutes} minute{'s' * (minutes > 1)} left"
