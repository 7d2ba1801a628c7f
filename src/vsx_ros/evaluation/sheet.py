"""A window on the ground, drawn to scale as inline SVG: its map, ways and marks, and round lengths."""

import base64
import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid

_HIGHEST_PX = 620.0  # a map and its caption fit on a screen
_MAX_DOTS, MAX_POINTS = 4000, 1500  # drawn at most, so that the report of an hour stays small
_Point = TypeVar("_Point")
Way = Sequence[Sequence[float] | None]
Window = tuple[FloatArray, FloatArray]


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """About ``count`` round numbers between low and high."""
    if not high > low:
        return [low]
    raw = (high - low) / count
    magnitude = 10.0 ** math.floor(math.log10(raw))
    step = next(m * magnitude for m in (1, 2, 5, 10) if m * magnitude >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 10) for i in range(first, math.floor(high / step + 1e-9) + 1)]


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

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [px]."""
        width, height = (self.high - self.low) * self.scale
        return float(width), float(height)

    def begin(self, title: str, name: str = "map") -> str:
        """The SVG's opening tag and title. name: its CSS classes."""
        width, height = self.size
        size = f'viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px"'
        return f'<svg class="{name}" {size} role="img"><title>{title}</title>'

    def at(self, point: Sequence[float]) -> tuple[float, float]:
        """x and y [px] of a point."""
        return float((point[0] - self.low[0]) * self.scale), float((self.high[1] - point[1]) * self.scale)

    def place(self, point: Sequence[float]) -> str:
        """The same as text."""
        x, y = self.at(point)
        return f"{x:.1f},{y:.1f}"

    def dots(self, points: Points2) -> str:
        """(N, 2) points, thinned if there are many."""
        shown = points[:: 1 + len(points) // _MAX_DOTS].tolist()
        return f'<path class="dots" d="{"".join(f"M{self.place(p)}h0" for p in shown)}"/>' if shown else ""

    def way(self, name: str, way: Way, colour: str = "") -> str:
        """A way of this CSS class; None leaves a gap."""
        style = f' style="stroke:{colour}"' if colour else ""
        runs = (" ".join(self.place(p) for p in run[:: 1 + len(run) // MAX_POINTS]) for run in unbroken(way))
        return "".join(f'<polyline class="{name}"{style} points="{points}"/>' for points in runs)

    def mark(self, name: str, point: Sequence[float]) -> str:
        """A disc at a point."""
        x, y = self.at(point)
        return f'<circle class="{name}" cx="{x:.1f}" cy="{y:.1f}" r="5"/>'

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
