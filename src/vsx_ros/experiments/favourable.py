"""Figure 3 of the paper: to which states one optimised segment leads, and how long it is, by the heading there."""

import math
from typing import Any

import numpy as np

from vsx_ros.evaluation.map_view import FIGURE_PX, Way, map_view, window_around
from vsx_ros.evaluation.page import Section, figures, paragraph
from vsx_ros.evaluation.svg import plot
from vsx_ros.experiments.drive import PHI_RAD_M
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.connect import connect
from vsx_ros.planning.path import Path
from vsx_ros.planning.two_level_qp import connect_paper

_PLACE = (2.0, 1.5)
_HEADINGS_DEG, _SHOWN_EVERY = range(0, 181, 5), 6
_PLACES, _NEAR_M, _FAR_M = 100, 1.0, 3.0


def figure3(seed: int) -> tuple[Section, dict[str, Any]]:
    """The section, and its numbers. seed: of the places that are drawn for the shares."""
    rng = np.random.default_rng(seed)
    bearings, distances = rng.uniform(0.0, math.pi / 2, _PLACES), rng.uniform(_NEAR_M, _FAR_M, _PLACES)
    places = np.column_stack([distances * np.cos(bearings), distances * np.sin(bearings)]).tolist()
    rows, ways, views = [], list[tuple[str, Way]](), []
    for heading in _HEADINGS_DEG:
        goal = SE2(*_PLACE, math.radians(heading))
        segment, default = connect_paper(SE2(), goal, PHI_RAD_M), connect(SE2(), goal, PHI_RAD_M)
        lengths_m = [way.length_m if isinstance(way, Path) else math.nan for way in (segment, default)]
        led = [isinstance(connect_paper(SE2(), SE2(x, y, goal.theta), PHI_RAD_M), Path) for x, y in places]
        rows.append([float(heading), *lengths_m, sum(led) / _PLACES])
        if heading % (_SHOWN_EVERY * _HEADINGS_DEG.step) == 0:
            name, way = ("planned", segment) if isinstance(segment, Path) else ("driven", default)
            if isinstance(way, Path):
                ways.append((name, way.sample(0.02)[:, :2].tolist()))
            views.append((*_PLACE, goal.theta))
    x, segment_m, default_m, share = np.array(rows).T
    window = window_around([way for _, way in ways], 0.6)
    ends = [("start", (0.0, 0.0)), ("goal", _PLACE)]
    lengths, size = [("first", x, segment_m), ("second", x, default_m)], (FIGURE_PX, 260.0)
    pictures = [
        ("to one place with several headings", map_view(None, ways, window, marks=ends, views=views)),
        ("length [m] over heading", plot(lengths, "m", math.ceil(np.nanmax(default_m)), unit="deg", size=size)),
        (f"share of {_PLACES} places ahead, {_NEAR_M:g} to {_FAR_M:g} m away, to which one segment leads, over heading",
         plot([("first", x, share)], "share", unit="deg", size=size)),
    ]  # fmt: skip
    words = (
        f"No obstacles; change of view at most {PHI_RAD_M:g} rad/m. Blue: one segment of the two-level optimisation "
        "(4.2, 4.3), where there is one. Dashed, and red in the curves: the default planner, which answers everywhere. "
        "A segment turns one way only, so the heading has to differ by more than the place's bearing: that makes it "
        "favourable. More than that makes it longer again."
    )
    names = ("heading_deg", "segment_m", "default_m", "share")
    numbers = [{name: None if math.isnan(value) else value for name, value in zip(names, row)} for row in rows]
    return Section("Figure 3: favourable states", paragraph(words) + figures(pictures)), {"rows": numbers}
