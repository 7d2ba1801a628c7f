"""Curves and a band of states as inline SVG, and pictures as data URLs. Maps from above: ``map_view.py``."""

import base64
import html
import math
from collections.abc import Sequence
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.slam.state import TrackingState

WIDTH, HEIGHT = 900.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 12.0, 12.0, 30.0
STATE_COLORS = {
    TrackingState.GOOD.word: "#2e9e5b",
    TrackingState.DUBIOUS.word: "#e0a422",
    TrackingState.LOST.word: "#cf3d3d",
    TrackingState.NOT_INITIALISED.word: "#9aa3ad",
}
_MAX_POINTS = 1500
_Point = TypeVar("_Point")


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """About ``count`` round numbers between low and high."""
    if not high > low:
        return [low]
    raw = (high - low) / count
    magnitude = 10.0 ** math.floor(math.log10(raw))
    step = next(m * magnitude for m in (1, 2, 5, 10) if m * magnitude >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 10) for i in range(first, math.floor(high / step + 1e-9) + 1)]


def decades(low: float, high: float) -> list[float]:
    """The powers of ten from the last one below low to the first one above high, both positive; two at least."""
    first = math.floor(math.log10(low))
    last = max(math.ceil(math.log10(high)), first + 1)
    return [10.0**power for power in range(first, last + 1)]


def plot(
    lines: Sequence[tuple[str, FloatArray, FloatArray]],
    label: str,
    top: float = 1.0,
    *,
    unit: str = "s",
    bottom: float = 0.0,
    marks: Sequence[tuple[float, str]] = (),
    size: tuple[float, float] = (WIDTH, HEIGHT),
) -> str:
    """Curves (CSS class, x from 0, y; NaN leaves a gap). unit: of x. bottom, top: ends of the y axis, which is one of
    decades where bottom is positive. marks: (value, name) level lines."""
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
    """A coloured band of states, in words, over time, with (second, name, text) marks above it."""
    height, end = 88.0, max(float(seconds[-1]), 1e-9)
    parts = [_open(WIDTH, height, "state of the tracking over time")]
    start = 0
    for i in range(1, len(states) + 1):
        if i == len(states) or states[i] != states[start]:
            last = min(i, len(states) - 1)
            begin, stop = (_x(float(seconds[k]), end, WIDTH) for k in (start, last))
            color = STATE_COLORS.get(states[start], "#7a6fd0")
            name = html.escape(f"{states[start]} from {seconds[start]:.1f} s")
            parts.append(
                f'<rect x="{begin:.1f}" y="30" width="{max(stop - begin, 1.0):.1f}" height="24" fill="{color}">'
                f"<title>{name}</title></rect>"
            )
            start = i
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
