"""The 2-D map: free, occupied, unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Float32Array, IntArray, Points2
from vsx_ros.errors import MapFileError

UNKNOWN, FREE, OCCUPIED = -1, 0, 100  # of nav_msgs/OccupancyGrid
MOST_FREE_PERCENT = 19  # map_server takes less than 19.6 % for free
MAX_CELLS = 2**24  # of a map from outside: 200 x 200 m at 5 cm
MAX_EXTENT_M = 1e6  # larger than any building; keeps cell indices in their range


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Cells as in nav_msgs/OccupancyGrid: -1 unknown, 0 free, 100 occupied.

    data: (H, W) int8, row 0 at the smallest y; read-only. resolution: metres per cell.
    origin_x, origin_y: world position of the outer corner of cell (0, 0) [m]; axes parallel to the world's.
    probability: (H, W) of an obstacle in each cell, as ``certainty.py`` finds it, None if nothing is known of it."""

    data: NDArray[np.int8]
    resolution: float
    origin_x: float
    origin_y: float
    probability: Float32Array | None = None

    def __post_init__(self) -> None:
        data = np.array(self.data, dtype=np.int8)
        if data.ndim != 2 or data.size == 0:
            raise MapFileError(f"a grid needs two dimensions and at least one cell, got shape {data.shape}")
        metres = abs(self.resolution), abs(self.origin_x), abs(self.origin_y)
        if not (self.resolution > 0 and all(value < MAX_EXTENT_M for value in metres)):
            raise MapFileError(
                f"grid with resolution {self.resolution} m and origin ({self.origin_x}, {self.origin_y}): "
                f"resolution must be positive, and both below {MAX_EXTENT_M:g} m"
            )
        if self.probability is not None and self.probability.shape != data.shape:
            raise MapFileError(
                f"a grid of {data.shape} cells needs a probability of each, got {self.probability.shape}"
            )
        data.flags.writeable = False
        object.__setattr__(self, "data", data)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.data.shape[0], self.data.shape[1]

    def cells(self, points_world: Points2) -> IntArray:
        """(N, 2) row and column of (N, 2) points [m]; may lie outside the grid."""
        points_world = np.asarray(points_world, float).reshape(-1, 2)
        column = np.floor((points_world[:, 0] - self.origin_x) / self.resolution)
        row = np.floor((points_world[:, 1] - self.origin_y) / self.resolution)
        return np.stack([row, column], axis=1).astype(np.int64)

    def centres(self, cells: IntArray) -> Points2:
        """(N, 2) world positions [m] of the centres of (N, 2) cells (row, column)."""
        cells = np.asarray(cells).reshape(-1, 2)
        x = self.origin_x + (cells[:, 1] + 0.5) * self.resolution
        y = self.origin_y + (cells[:, 0] + 0.5) * self.resolution
        return np.stack([x, y], axis=1)

    def contains(self, cells: IntArray) -> BoolArray:
        """(N,) whether each (row, column) lies inside."""
        cells = np.asarray(cells).reshape(-1, 2)
        return (cells[:, 0] >= 0) & (cells[:, 0] < self.shape[0]) & (cells[:, 1] >= 0) & (cells[:, 1] < self.shape[1])

    def around(self, x: float, y: float, reach_m: float) -> OccupancyGrid:
        """The part within reach_m of a place [m], at least a cell; beyond it is outside the map."""
        corners = self.cells(np.array([[x - reach_m, y - reach_m], [x + reach_m, y + reach_m]]))
        (top, left), (bottom, right) = np.clip(corners, 0, np.array(self.shape) - 1).tolist()
        return replace(self, **self._fields_of(slice(top, bottom + 1), slice(left, right + 1)))

    def _fields_of(self, rows: slice, columns: slice) -> dict[str, Any]:
        """What differs in a part of the grid."""
        return {
            "data": self.data[rows, columns],
            "origin_x": self.origin_x + columns.start * self.resolution,
            "origin_y": self.origin_y + rows.start * self.resolution,
            "probability": None if self.probability is None else self.probability[rows, columns],
        }

    def value_at(self, x: float, y: float) -> int:
        """The cell's value at a world position [m]; UNKNOWN outside."""
        cell = self.cells(np.array([[x, y]]))
        return int(self.data[cell[0, 0], cell[0, 1]]) if bool(self.contains(cell)[0]) else UNKNOWN

    def percent(self) -> NDArray[np.int8]:
        """(H, W) of nav_msgs/OccupancyGrid: the data, but free cells with the percentage of their probability, up to
        the most that map_server takes for free."""
        if self.probability is None:
            return self.data
        percent = np.minimum(np.rint(100.0 * np.nan_to_num(self.probability)), MOST_FREE_PERCENT)
        return np.where(self.data == FREE, percent, self.data).astype(np.int8)

    @property
    def drivable(self) -> BoolArray:
        """(H, W) cells that the body may be on: the free ones. ``ZonedGrid`` has fewer."""
        return np.asarray(self.data == FREE)

    @property
    def known_area_m2(self) -> float:
        """Area of all cells that are free or occupied [m2]."""
        return float(np.count_nonzero(self.data != UNKNOWN)) * self.resolution**2
