"""Ways over a map, and curves over distance, as inline SVG."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.evaluation.svg import grid_image, png_url, ticks
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid

_PX_PER_M = 60.0
_VIEW_M = 0.35
Way = Sequence[Sequence[float] | None]


def ways_picture(
    grid: OccupancyGrid, ways: Sequence[tuple[str, Way]], marks: Sequence[tuple[str, Sequence[float]]] = (),
    views: Sequence[Sequence[float]] = (), around: float | None = None, T_picture_grid: SE2 = SE2(),  # noqa: B008
) -> str:  # fmt: skip
    """A map from above, north up. ways: (CSS class, points; None leaves a gap). marks: (CSS class, point). views:
    x, y, heading of short strokes. around: show only so many metres around ways and marks. T_picture_grid: where the
    grid lies."""
    low, high = _extent(grid, T_picture_grid, [p for _, way in ways for p in way if p is not None], around)
    width, height = (high - low) * _PX_PER_M

    def place(point: Sequence[float]) -> str:
        return f"{(point[0] - low[0]) * _PX_PER_M:.1f},{(high[1] - point[1]) * _PX_PER_M:.1f}"

    parts = [f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img"><title>map from above</title>']
    parts.append(_background(grid, T_picture_grid, low, high))
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


def _background(grid: OccupancyGrid, T: SE2, low: Points2, high: Points2) -> str:
    rows, columns = grid.shape
    size = np.array([columns, rows]) * grid.resolution * _PX_PER_M
    x, y = (T.x - low[0]) * _PX_PER_M, (high[1] - T.y) * _PX_PER_M
    dx = grid.origin_x * _PX_PER_M
    dy = -(grid.origin_y * _PX_PER_M + size[1])
    return (
        f'<g transform="translate({x:.1f} {y:.1f}) rotate({-np.degrees(T.theta):.2f})"><image x="{dx:.1f}" '
        f'y="{dy:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}" preserveAspectRatio="none" '
        f'style="image-rendering:pixelated" href="{png_url(grid_image(grid))}"/></g>'
    )


def _extent(
    grid: OccupancyGrid, T: SE2, points: Sequence[Sequence[float]], around: float | None
) -> tuple[Points2, Points2]:
    if around is not None and points:
        xy = np.array([point[:2] for point in points])
        return xy.min(axis=0) - around, xy.max(axis=0) + around
    rows, columns = grid.shape
    size = np.array([columns, rows]) * grid.resolution
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size + [grid.origin_x, grid.origin_y]
    placed = T @ corners
    return placed.min(axis=0), placed.max(axis=0)


def _unbroken(way: Way) -> list[list[Sequence[float]]]:
    runs: list[list[Sequence[float]]] = [[]]
    for point in way:
        if point is not None:
            runs[-1].append(point)
        elif runs[-1]:
            runs.append([])
    return [run for run in runs if len(run) > 1]
