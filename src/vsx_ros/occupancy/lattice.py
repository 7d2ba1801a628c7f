"""The cells that a map of the floor consists of, before they are a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import FloatArray, Points2

_MARGIN_M = 0.5


@dataclass(frozen=True)
class Lattice:
    """Rows and columns of a grid whose origin is a whole number of cells away from the world's."""

    rows: int
    columns: int
    resolution: float
    origin_x: float
    origin_y: float

    @staticmethod
    def around(points: Points2, resolution: float) -> Lattice:
        """The smallest lattice with a margin around (N, 2) points; around the origin if there are none."""
        points = np.vstack([points, np.zeros((0 if len(points) else 1, 2))])
        low = np.floor((points.min(axis=0) - _MARGIN_M) / resolution).astype(int)
        high = np.ceil((points.max(axis=0) + _MARGIN_M) / resolution).astype(int)
        columns, rows = (high - low).tolist()
        return Lattice(rows, columns, resolution, float(low[0] * resolution), float(low[1] * resolution))

    def arguments(self) -> tuple[int, int, float, float, float]:
        """In the order that kernels take them."""
        return self.rows, self.columns, self.resolution, self.origin_x, self.origin_y

    def centres(self) -> tuple[FloatArray, FloatArray]:
        """x of each column (1, columns) and y of each row (rows, 1) [m]."""
        x = self.origin_x + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.resolution
        y = self.origin_y + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.resolution
        return x[None, :], y[:, None]
