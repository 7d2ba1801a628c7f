"""Curves, a band of states and maps from above as inline SVG."""

import html
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.evaluation.sheet import MAX_POINTS, Sheet, Way, Window, ticks, unbroken
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.slam.state import TrackingState

WIDTH, HEIGHT = 900.0, 190.0  # px, of a diagram over time
_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 12.0, 12.0, 30.0  # px around the plot, for its labels
STATE_COLORS = {
    TrackingState.GOOD.word: "#2e9e5b",
    TrackingState.DUBIOUS.word: "#e0a422",
    TrackingState.LOST.word: "#cf3d3d",
    TrackingState.NOT_INITIALISED.word: "#9aa3ad",
}
FIGURE_PX = 540.0  # largest width of a map
_VIEW_M = 0.35  # length of the arrow that shows a view


def state_color(word: str) -> str:
    """The colour of a tracking state's word, also for a word from another version."""
    return STATE_COLORS.get(word, "#7a6fd0")


def top(values: FloatArray) -> float:
    """A round upper limit for an axis that shows 99.5 % of the values."""
    highest = float(np.nanpercentile(values, 99.5)) * 1.1
    return max(ticks(0.0, highest * 1.25, 5)[-1], 1e-3)


def decades(low: float, high: float) -> list[float]:
    """The powers of ten from the last one below low to the first one above high (both positive); at least two."""
    first = math.floor(math.log10(low))
    last = max(math.ceil(math.log10(high)), first + 1)
    return [10.0**power for power in range(first, last + 1)]


def plot(
    lines: Sequence[tuple[str, FloatArray, FloatArray]], label: str, top: float = 1.0, *, unit: str = "s",
    bottom: float = 0.0, marks: Sequence[tuple[float, str]] = (), size: tuple[float, float] = (WIDTH, HEIGHT),
) -> str:  # fmt: skip
    """Curves (CSS class, x from 0, y; NaN leaves a gap). unit: of x. bottom, top: ends of the y axis, which is
    logarithmic if bottom is positive. marks: (value, name) of horizontal lines."""
    width, height = size
    end = max((float(x[-1]) for _, x, _ in lines if len(x)), default=0.0) or 1e-9
    right = width - _RIGHT

    def y_px(value: float) -> float:
        share = math.log(max(value, bottom) / bottom) / math.log(top / bottom) if bottom > 0.0 else value / top
        return _TOP + (1.0 - min(share, 1.0)) * (height - _TOP - _BOTTOM)

    parts = [_open(width, height, label)]
    for tick in decades(bottom, top) if bottom > 0.0 else ticks(0.0, top, 4):
        parts.append(f'<line class="grid" x1="{_LEFT}" y1="{y_px(tick):.1f}" x2="{right}" y2="{y_px(tick):.1f}"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y_px(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts.append(_axis(end, unit, width, height))
    for value, name in marks:
        parts.append(f'<line class="mark" x1="{_LEFT}" y1="{y_px(value):.1f}" x2="{right}" y2="{y_px(value):.1f}"/>')
        parts.append(f'<text class="mark" x="{right}" y="{y_px(value) - 4:.1f}" text-anchor="end">{name}</text>')
    for name, x, y in lines:
        step = max(1, len(x) // MAX_POINTS)
        points = [
            f"{_x(place, end, width):.1f},{y_px(value):.1f}" if math.isfinite(value) else None
            for place, value in zip(x[::step].tolist(), y[::step].tolist())
        ]
        parts += [f'<polyline class="{name}" points="{" ".join(run)}"/>' for run in unbroken(points)]
    return "".join([*parts, "</svg>"])


def state_band(seconds: FloatArray, states: Sequence[str], marks: Sequence[tuple[float, str, str]]) -> str:
    """A coloured band of states (words) over time, with (second, name, text) marks above it."""
    height, end = 88.0, max(float(seconds[-1]), 1e-9)
    parts = [_open(WIDTH, height, "state of the tracking over time")]
    starts = [i for i in range(len(states)) if i == 0 or states[i] != states[i - 1]]
    for start, after in pairwise([*starts, len(states) - 1]):
        begin, stop = (_x(float(seconds[k]), end, WIDTH) for k in (start, after))
        name = html.escape(f"{states[start]} from {seconds[start]:.1f} s")
        parts.append(
            f'<rect x="{begin:.1f}" y="30" width="{max(stop - begin, 1.0):.1f}" height="24" '
            f'fill="{state_color(states[start])}"><title>{name}</title></rect>'
        )
    for second, name, text in marks:
        title = html.escape(f"{second:.1f} s  {name}: {text}")
        at = _x(second, end, WIDTH)
        parts.append(f'<path class="event" d="M{at:.1f} 28 l-5 -11 l10 0 z"><title>{title}</title></path>')
    return "".join([*parts, _axis(end, "s", WIDTH, height), "</svg>"])


def _open(width: float, height: float, label: str) -> str:
    return f'<svg class="plot" viewBox="0 0 {width:.0f} {height:.0f}" role="img"><title>{html.escape(label)}</title>'


def _x(value: float, end: float, width: float) -> float:
    return _LEFT + value / end * (width - _LEFT - _RIGHT)


def _axis(end: float, unit: str, width: float, height: float) -> str:
    y = height - 8
    return "".join(
        f'<text x="{_x(tick, end, width):.1f}" y="{y:.1f}" text-anchor="middle">{tick:g} {unit}</text>'
        for tick in ticks(0.0, end, 8 if width >= WIDTH else 5)
    )


def map_view(
    grid: OccupancyGrid | None, ways: Sequence[tuple[str, Way]], window: Window, *,
    marks: Sequence[tuple[str, Sequence[float]]] = (), views: Sequence[Sequence[float]] = (),
    dots: Points2 | None = None, unit: str = "m", width_px: float = FIGURE_PX,
) -> str:  # fmt: skip
    """A map, north up, with a scale bar. ways: (CSS class, points; None leaves a gap). marks: (CSS class, point).
    views: x, y, heading of short strokes. dots: (N, 2), thinned if there are many. window: lower and upper corner.
    Lengths in ``unit``."""
    sheet = Sheet.fitting(window, width_px)
    parts = [sheet.begin("map from above")]
    if grid is not None:
        parts.append(sheet.ground(grid))
    if dots is not None:
        parts.append(sheet.dots(dots))
    for x_m, y_m, theta in views:
        tip = x_m + _VIEW_M * np.cos(theta), y_m + _VIEW_M * np.sin(theta)
        parts.append(f'<polyline class="view" points="{sheet.place((x_m, y_m))} {sheet.place(tip)}"/>')
    parts += [sheet.way(name, way) for name, way in ways]
    parts += [sheet.mark(name, point) for name, point in marks]
    return "".join([*parts, sheet.scale_bar(unit), "</svg>"])
