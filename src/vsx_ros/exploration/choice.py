"""The choice of a view in words: what the drive is for, and what would have been the next best place."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2

_PLACE = re.compile(r" \[view at \((-?\d{1,6}\.\d), (-?\d{1,6}\.\d)\) looking (-?\d{1,3}) deg, ")


class Choice(NamedTuple):
    """The chosen view, and the best one that looks at another place; None if no such one was ranked."""

    view: View
    second: View | None

    @staticmethod
    def among(views: Sequence[View], range_m: float) -> Choice:
        """The first of the ranked views. range_m: of the camera; of views whose middles lie within half of it only one
        counts."""
        half_m = 0.5 * range_m
        middles = np.array([view.ahead(half_m) for view in views])
        elsewhere = np.flatnonzero(np.hypot(*(middles - middles[0]).T) > half_m)
        return Choice(views[0], views[int(elsewhere[0])] if len(elsewhere) else None)

    def words(self, stop_cost_m: float) -> str:
        """For people, then the figures in brackets; stop_cost_m [m] is part of d."""
        view, second = self
        chosen = f"driving {view.distance_m:.1f} m to look at {view.gain_m2:.1f} m2 of unknown ground"
        figures = f"view at {_figures(view, 'U = v/d x landmarks = ', stop_cost_m)}"
        if second is None:
            return f"{chosen}; no other place comes near [{figures}]"
        share = f", {100 * second.utility / view.utility:.0f} % as good" if view.utility > 0.0 else ""
        other = f"second best: {second.gain_m2:.1f} m2 after {second.distance_m:.1f} m{share}"
        return f"{chosen}; {other} [{figures}; second best at {_figures(second, 'U = ', stop_cost_m)}]"


def chosen_in(words: str) -> SE2 | None:
    """The place of the chosen view in the words of a choice, to 10 cm and a degree; None for other words."""
    found = _PLACE.search(words)
    return SE2(float(found[1]), float(found[2]), math.radians(float(found[3]))) if found else None


def _figures(view: View, name: str, stop_cost_m: float) -> str:
    x, y, heading_deg = view.pose.x, view.pose.y, math.degrees(view.pose.theta)
    d_m, share = view.distance_m + stop_cost_m, view.landmark_factor(stop_cost_m)
    return (
        f"({x:.1f}, {y:.1f}) looking {heading_deg:.0f} deg, {view.landmarks} landmarks: "
        f"{name}{view.gain_m2:.1f} m2 / {d_m:.1f} m x {share:.2f} = {view.utility:.2f}"
    )
