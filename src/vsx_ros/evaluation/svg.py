"""Curves, a band of states and maps from above as inline SVG, and images as data URLs."""

import base64
import html
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
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
_HIGHEST_PX = 620.0  # a map and its caption fit on a screen
_VIEW_M = 0.35  # length of the arrow that shows a view
_MAX_DOTS, _MAX_POINTS = 4000, 1500  # drawn at most, so that the report of an hour stays small
_Point = TypeVar("_Point")
Way = Sequence[Sequence[float] | None]
Window = tuple[FloatArray, FloatArray]


def state_color(word: str) -> str:
    """The colour of a tracking state's word, also for a word from another version."""
    return STATE_COLORS.get(word, "#7a6fd0")


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """About ``count`` round numbers between low and high."""
    if not high > low:
        return [low]
    raw = (high - low) / count
    magnitude = 10.0 ** math.floor(math.log10(raw))
    step = next(m * magnitude for m in (1, 2, 5, 10) if m * magnitude >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 10) for i in range(first, math.floor(high / step + 1e-9) + 1)]


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
        step = max(1, len(x) // _MAX_POINTS)
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


def unbroken(points: Sequence[_Point | None]) -> list[list[_Point]]:
    """The runs without None."""
    runs: list[list[_Point]] = [[]]
    for point in points:
        if point is not None:
            runs[-1].append(point)
        elif runs[-1]:
            runs.append([])
    return [run for run in runs if run]


def grid_image(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """(H, W, 4) BGRA picture, north up: free white, occupied black, unknown transparent."""
    image = np.full((*grid.shape, 4), (0, 0, 0, 0), np.uint8)
    image[grid.data == FREE] = (255, 255, 255, 255)
    image[grid.data == OCCUPIED] = (40, 30, 30, 255)
    return image[::-1].copy()


def png_url(image: NDArray[np.uint8]) -> str:
    """The picture as a data URL."""
    return "data:image/png;base64," + base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode("ascii")


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
    if dots is not None and len(dots):
        shown = dots[:: 1 + len(dots) // _MAX_DOTS].tolist()
        parts.append(f'<path class="dots" d="{"".join(f"M{sheet.place(p)}h0" for p in shown)}"/>')
    for x_m, y_m, theta in views:
        tip = x_m + _VIEW_M * np.cos(theta), y_m + _VIEW_M * np.sin(theta)
        parts.append(f'<polyline class="view" points="{sheet.place((x_m, y_m))} {sheet.place(tip)}"/>')
    for name, way in ways:
        for run in unbroken(way):
            points = " ".join(sheet.place(p) for p in run[:: 1 + len(run) // _MAX_POINTS])
            parts.append(f'<polyline class="{name}" points="{points}"/>')
    for name, point in marks:
        x, y = sheet.place(point).split(",")
        parts.append(f'<circle class="{name}" cx="{x}" cy="{y}" r="5"/>')
    return "".join([*parts, sheet.scale_bar(unit), "</svg>"])


class Sheet(NamedTuple):
    """A window between two corners, drawn with ``scale`` pixels per unit of length; x to the right, y up."""

    low: FloatArray
    high: FloatArray
    scale: float

    @staticmethod
    def fitting(window: Window, width_px: float) -> "Sheet":
        """As large as the width allows, and not too high for a screen."""
        low, high = window
        return Sheet(low, high, min(width_px / (high[0] - low[0]), _HIGHEST_PX / (high[1] - low[1])))

    def begin(self, title: str) -> str:
        """The SVG's opening tag and title."""
        width, height = (self.high - self.low) * self.scale
        size = f'viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px"'
        return f'<svg class="map" {size} role="img"><title>{title}</title>'

    def place(self, point: Sequence[float]) -> str:
        """x and y [px] of a point."""
        return f"{(point[0] - self.low[0]) * self.scale:.1f},{(self.high[1] - point[1]) * self.scale:.1f}"

    def ground(self, grid: OccupancyGrid) -> str:
        """The picture of a map."""
        corner, end = window_of(grid)
        x, y = self.place((corner[0], end[1])).split(",")
        size = (end - corner) * self.scale
        return (
            f'<image x="{x}" y="{y}" width="{size[0]:.1f}" height="{size[1]:.1f}" preserveAspectRatio="none" '
            f'style="image-rendering:pixelated" href="{png_url(grid_image(grid))}"/>'
        )

    def scale_bar(self, unit: str) -> str:
        """A bar of a round length."""
        width, height = self.high - self.low
        bar = ticks(0.0, float(width), 5)[:2][-1]  # there is one tick only if rounding leaves no width
        bottom = height * self.scale
        return (
            f'<path class="bar" d="M12 {bottom - 12:.1f}h{bar * self.scale:.1f}"/>'
            f'<text x="12" y="{bottom - 18:.1f}">{bar:g} {unit}</text>'
        )


def window_of(grid: OccupancyGrid) -> Window:
    """The lower and upper corner of a grid."""
    low = np.array([grid.origin_x, grid.origin_y])
    return low, low + np.array(grid.shape)[::-1] * grid.resolution


def window_around(ways: Sequence[Way], margin: float | None = None) -> Window:
    """The window around ways with a margin, by default a twentieth of their extent and a little more; never empty."""
    points = np.array([point[:2] for way in ways for point in way if point is not None]).reshape(-1, 2)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    margin = 0.05 * float((high - low).max()) + 0.05 if margin is None else margin
    return low - margin, high + margin
