"""The few drawings of the report, as inline SVG: a plot over time, a band of states, a map from above."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.slam.state import TrackingState

WIDTH = 900.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 12.0, 12.0, 30.0
STATE_COLORS = {
    TrackingState.GOOD.word: "#2e9e5b",
    TrackingState.DUBIOUS.word: "#e0a422",
    TrackingState.LOST.word: "#cf3d3d",
    TrackingState.NOT_INITIALISED.word: "#9aa3ad",
}
_MAX_POINTS = 1500


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


def time_plot(
    seconds: FloatArray,
    values: FloatArray,
    label: str,
    top: float,
    marks: Sequence[tuple[float, str]] = (),
    bottom: float = 0.0,
) -> str:
    """A curve over time. values: NaN leaves a gap. bottom, top: ends of the axis, which is one of decades where bottom
    is positive. marks: (value, name) level lines."""
    height, end = 190.0, max(float(seconds[-1]), 1e-9)
    px, py = WIDTH - _LEFT - _RIGHT, height - _TOP - _BOTTOM

    def x(second: float) -> float:
        return _LEFT + second / end * px

    def y(value: float) -> float:
        share = math.log(max(value, bottom) / bottom) / math.log(top / bottom) if bottom > 0.0 else value / top
        return _TOP + (1.0 - min(share, 1.0)) * py

    parts = [_open(height, label)]
    for tick in decades(bottom, top) if bottom > 0.0 else ticks(0.0, top, 4):
        parts.append(f'<line class="grid" x1="{_LEFT}" y1="{y(tick):.1f}" x2="{WIDTH - _RIGHT}" y2="{y(tick):.1f}"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts.append(_time_axis(end, x, height))
    for value, name in marks:
        parts.append(f'<line class="mark" x1="{_LEFT}" y1="{y(value):.1f}" x2="{WIDTH - _RIGHT}" y2="{y(value):.1f}"/>')
        parts.append(f'<text class="mark" x="{WIDTH - _RIGHT}" y="{y(value) - 4:.1f}" text-anchor="end">{name}</text>')
    step = max(1, len(seconds) // _MAX_POINTS)
    for run in _unbroken(np.asarray(values, float)[::step]):
        shown = [f"{x(float(seconds[i * step])):.1f},{y(float(values[i * step])):.1f}" for i in run]
        parts.append(f'<polyline class="curve" points="{" ".join(shown)}"/>')
    return "".join([*parts, "</svg>"])


def state_band(seconds: FloatArray, states: Sequence[str], marks: Sequence[tuple[float, str, str]]) -> str:
    """A coloured band of states, in words, over time, with (second, name, text) marks above it."""
    height, end = 88.0, max(float(seconds[-1]), 1e-9)
    px = WIDTH - _LEFT - _RIGHT

    def x(second: float) -> float:
        return _LEFT + second / end * px

    parts = [_open(height, "state of the tracking over time")]
    start = 0
    for i in range(1, len(states) + 1):
        if i == len(states) or states[i] != states[start]:
            begin, stop = x(float(seconds[start])), x(float(seconds[min(i, len(states) - 1)]))
            color = STATE_COLORS.get(states[start], "#7a6fd0")
            name = html.escape(f"{states[start]} from {seconds[start]:.1f} s")
            parts.append(
                f'<rect x="{begin:.1f}" y="30" width="{max(stop - begin, 1.0):.1f}" height="24" fill="{color}">'
                f"<title>{name}</title></rect>"
            )
            start = i
    for second, name, text in marks:
        title = html.escape(f"{second:.1f} s  {name}: {text}")
        parts.append(f'<path class="event" d="M{x(second):.1f} 28 l-5 -11 l10 0 z"><title>{title}</title></path>')
    return "".join([*parts, _time_axis(end, x, height), "</svg>"])


def map_view(
    grid: OccupancyGrid | None, points: Points2, lines: Sequence[tuple[str, Points2]], axes: tuple[str, str], unit: str
) -> str:
    """The map from above: grid as a picture, points as dots, lines by CSS class; a scale bar."""
    low, high = _extent(grid, [points, *(line for _, line in lines)])
    scale = min(WIDTH / (high[0] - low[0]), 620.0 / (high[1] - low[1]))
    width, height = (high - low) * scale

    def place(xy: Points2) -> Points2:
        return np.column_stack([(xy[:, 0] - low[0]) * scale, (high[1] - xy[:, 1]) * scale])

    size = f"{width:.0f}"
    parts = [f'<svg class="map" viewBox="0 0 {size} {height:.0f}" style="max-width:{size}px" role="img">']
    parts.append(f"<title>map from above, {axes[0]} to the right, {axes[1]} up</title>")
    if grid is not None:
        rows, columns = grid.shape
        corner = place(np.array([[grid.origin_x, grid.origin_y + rows * grid.resolution]]))[0]
        size = np.array([columns, rows]) * grid.resolution * scale
        parts.append(
            f'<image x="{corner[0]:.1f}" y="{corner[1]:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}" '
            f'preserveAspectRatio="none" style="image-rendering:pixelated" href="{png_url(grid_image(grid))}"/>'
        )
    dots = "".join(f"M{u:.1f} {v:.1f}h0" for u, v in place(points)) if len(points) else ""
    parts.append(f'<path class="dots" d="{dots}"/>')
    for name, line in lines:
        pixels = place(line[:: max(1, len(line) // _MAX_POINTS)]) if len(line) else np.zeros((0, 2))
        parts.append(f'<polyline class="{name}" points="{" ".join(f"{u:.1f},{v:.1f}" for u, v in pixels)}"/>')
        if len(pixels):
            parts.append(f'<circle class="{name}" cx="{pixels[0, 0]:.1f}" cy="{pixels[0, 1]:.1f}" r="5"/>')
    bar = ticks(0.0, float(high[0] - low[0]), 5)[1]
    parts.append(f'<path class="bar" d="M12 {height - 12:.1f}h{bar * scale:.1f}"/>')
    parts.append(f'<text x="12" y="{height - 18:.1f}">{bar:g} {unit}</text></svg>')
    return "".join(parts)


def grid_image(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """(H, W, 4) BGRA picture, north up: free white, occupied black, unknown transparent."""
    image = np.full((*grid.shape, 4), (0, 0, 0, 0), np.uint8)
    image[grid.data == FREE] = (255, 255, 255, 255)
    image[grid.data == OCCUPIED] = (40, 30, 30, 255)
    return image[::-1].copy()


def png_url(image: NDArray[np.uint8]) -> str:
    """The picture as a data URL."""
    return "data:image/png;base64," + base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode("ascii")


def _open(height: float, label: str) -> str:
    return f'<svg class="plot" viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img"><title>{html.escape(label)}</title>'


def _time_axis(end: float, x: Callable[[float], float], height: float) -> str:
    places = [(x(tick), tick) for tick in ticks(0.0, end, 8)]
    y = height - 8
    return "".join(f'<text x="{at:.1f}" y="{y:.1f}" text-anchor="middle">{tick:g} s</text>' for at, tick in places)


def _unbroken(values: FloatArray) -> list[list[int]]:
    """Index runs without NaN."""
    runs: list[list[int]] = [[]]
    for i, value in enumerate(values):
        if np.isfinite(value):
            runs[-1].append(i)
        elif runs[-1]:
            runs.append([])
    return [run for run in runs if run]


def _extent(grid: OccupancyGrid | None, clouds: Sequence[Points2]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner around everything, not square, never empty; of dots only the inner 98 %."""
    corners = [np.percentile(c, [1, 99], axis=0) if i == 0 else c for i, c in enumerate(clouds) if len(c)]
    if grid is not None:
        origin = np.array([grid.origin_x, grid.origin_y])
        corners += [origin[None], (origin + np.array(grid.shape)[::-1] * grid.resolution)[None]]
    everything = np.vstack([*corners, np.zeros((1 if not corners else 0, 2))])
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.05 * float((high - low).max()) + 0.05
    return low - margin, high + margin
