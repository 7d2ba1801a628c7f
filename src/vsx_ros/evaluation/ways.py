"""Ways over a map, and curves over distance, as inline SVG."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.evaluation.svg import grid_image, png_url, ticks
from vsx_ros.occupancy.grid import OccupancyGrid

_PX_PER_M = 60.0
_VIEW_M = 0.35
_MAX_DOTS = 3000
Way = Sequence[Sequence[float] | None]
Window = tuple[FloatArray, FloatArray]


def ways_picture(
    grid: OccupancyGrid,
    ways: Sequence[tuple[str, Way]],
    marks: Sequence[tuple[str, Sequence[float]]] = (),
    views: Sequence[Sequence[float]] = (),
    dots: Points2 | None = None,
    window: Window | None = None,
) -> str:
    """A map from above, north up. ways: (CSS class, points; None leaves a gap). marks: (CSS class, point). views:
    x, y, heading of short strokes. dots: (N, 2), thinned where they are many. window: what to show, all of the grid by
    default. Lengths in metres."""
    low, high = window or window_of(grid)
    width, height = (high - low) * _PX_PER_M

    def place(point: Sequence[float]) -> str:
        return f"{(point[0] - low[0]) * _PX_PER_M:.1f},{(high[1] - point[1]) * _PX_PER_M:.1f}"

    parts = [f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img"><title>map from above</title>']
    parts.append(_background(grid, low, high))
    if dots is not None and len(dots):
        shown = dots[:: 1 + len(dots) // _MAX_DOTS].tolist()
        parts.append(f'<path class="dots" d="{"".join(f"M{place(p)}h0" for p in shown)}"/>')
    for x, y, theta in views:
        tip = x + _VIEW_M * np.cos(theta), y + _VIEW_M * np.sin(theta)
        parts.append(f'<polyline class="view" points="{place((x, y))} {place(tip)}"/>')
    for name, way in ways:
        for run in _unbroken(way):
            parts.append(f'<polyline class="{name}" points="{" ".join(place(p) for p in run)}"/>')
    for name, point in marks:
        x_px, y_px = place(point).split(",")
        parts.append(f'<circle class="{name}" cx="{x_px}" cy="{y_px}" r="7"/>')
    return "".join([*parts, "</svg>"])


def window_of(grid: OccupancyGrid) -> Window:
    """All of a grid: its lower and upper corner."""
    low = np.array([grid.origin_x, grid.origin_y])
    return low, low + np.array(grid.shape)[::-1] * grid.resolution


def window_around(ways: Sequence[tuple[str, Way]], margin_m: float) -> Window:
    """So many metres around ways that are not all empty."""
    points = np.array([point[:2] for _, way in ways for point in way if point is not None])
    return points.min(axis=0) - margin_m, points.max(axis=0) + margin_m


def curves(lines: Sequence[tuple[str, FloatArray, FloatArray]], x_label: str, y_label: str) -> str:
    """Curves (CSS class, x, y) with y from 0 to 1."""
    width, height, left, bottom = 520.0, 260.0, 46.0, 34.0
    end = max((float(x[-1]) for _, x, _ in lines if len(x)), default=1.0) or 1.0

    def at(x: float, y: float) -> str:
        return f"{left + x / end * (width - left - 12):.1f},{(height - bottom) * (1 - y) + 8 * y:.1f}"

    parts = [f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img"><title>{html.escape(y_label)}</title>']
    for tick in ticks(0.0, 1.0, 4):
        y_px = at(0.0, tick).split(",")[1]
        parts.append(f'<path class="grid" d="M{left} {y_px}H{width - 12}"/>')
        parts.append(f'<text x="{left - 6}" y="{float(y_px) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in ticks(0.0, end, 6):
        x_px = at(tick, 0.0).split(",")[0]
        parts.append(f'<text x="{x_px}" y="{height - 16:.0f}" text-anchor="middle">{tick:g}</text>')
    parts.append(f'<text x="{width / 2:.0f}" y="{height - 2:.0f}" text-anchor="middle">{html.escape(x_label)}</text>')
    for name, x, y in lines:
        points = " ".join(at(float(a), float(b)) for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline class="{name}" points="{points}"/>')
    return "".join([*parts, "</svg>"])


def _background(grid: OccupancyGrid, low: FloatArray, high: FloatArray) -> str:
    corner, end = window_of(grid)
    x, y = (corner[0] - low[0]) * _PX_PER_M, (high[1] - end[1]) * _PX_PER_M
    width, height = (end - corner) * _PX_PER_M
    return (
        f'<image x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" preserveAspectRatio="none" '
        f'style="image-rendering:pixelated" href="{png_url(grid_image(grid))}"/>'
    )


def _unbroken(way: Way) -> list[list[Sequence[float]]]:
    runs: list[list[Sequence[float]]] = [[]]
    for point in way:
        if point is not None:
            runs[-1].append(point)
        elif runs[-1]:
            runs.append([])
    return [run for run in runs if len(run) > 1]
