"""A map from above with ways over it, as inline SVG."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.evaluation.svg import grid_image, png_url, ticks, unbroken
from vsx_ros.occupancy.grid import OccupancyGrid

_HIGHEST_PX = 620.0
FIGURE_PX = 540.0
_VIEW_M = 0.35
_MAX_DOTS, _MAX_POINTS = 4000, 1500
Way = Sequence[Sequence[float] | None]
Window = tuple[FloatArray, FloatArray]


def map_view(
    grid: OccupancyGrid | None,
    ways: Sequence[tuple[str, Way]],
    window: Window,
    *,
    marks: Sequence[tuple[str, Sequence[float]]] = (),
    views: Sequence[Sequence[float]] = (),
    dots: Points2 | None = None,
    unit: str = "m",
    width_px: float = FIGURE_PX,
) -> str:
    """North up, with a scale bar. ways: (CSS class, points; None leaves a gap). marks: (CSS class, point). views: x, y,
    heading of short strokes. dots: (N, 2), thinned where they are many. window: lower and upper corner. Lengths in
    ``unit``."""
    low, high = window
    sheet = _Sheet(low, high, min(width_px / (high[0] - low[0]), _HIGHEST_PX / (high[1] - low[1])))
    width, height = (high - low) * sheet.scale
    parts = [f'<svg class="map" viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px" role="img">']
    parts.append("<title>map from above</title>")
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


class _Sheet(NamedTuple):
    """The window between two corners, drawn with ``scale`` pixels per unit of length; x to the right, y up."""

    low: FloatArray
    high: FloatArray
    scale: float

    def place(self, point: Sequence[float]) -> str:
        return f"{(point[0] - self.low[0]) * self.scale:.1f},{(self.high[1] - point[1]) * self.scale:.1f}"

    def ground(self, grid: OccupancyGrid) -> str:
        corner, end = window_of(grid)
        x, y = self.place((corner[0], end[1])).split(",")
        size = (end - corner) * self.scale
        return (
            f'<image x="{x}" y="{y}" width="{size[0]:.1f}" height="{size[1]:.1f}" preserveAspectRatio="none" '
            f'style="image-rendering:pixelated" href="{png_url(grid_image(grid))}"/>'
        )

    def scale_bar(self, unit: str) -> str:
        width, height = self.high - self.low
        bar = ticks(0.0, float(width), 5)[:2][-1]  # one alone where far numbers leave no width
        bottom = height * self.scale
        return (
            f'<path class="bar" d="M12 {bottom - 12:.1f}h{bar * self.scale:.1f}"/>'
            f'<text x="12" y="{bottom - 18:.1f}">{bar:g} {unit}</text>'
        )


def window_of(grid: OccupancyGrid) -> Window:
    """All of a grid: its lower and upper corner."""
    low = np.array([grid.origin_x, grid.origin_y])
    return low, low + np.array(grid.shape)[::-1] * grid.resolution


def window_around(ways: Sequence[Way], margin: float | None = None) -> Window:
    """So much around ways, by default a twentieth of their extent and a little more; never empty."""
    points = np.array([point[:2] for way in ways for point in way if point is not None]).reshape(-1, 2)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    margin = 0.05 * float((high - low).max()) + 0.05 if margin is None else margin
    return low - margin, high + margin
