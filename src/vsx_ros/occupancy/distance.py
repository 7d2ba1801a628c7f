"""How far one is from what is not known to be free, and how far it is to drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2
from vsx_ros.kernels.occupancy.clearance import fringe, gradient_many, interpolate_many, least_on_curve, signed_distance
from vsx_ros.kernels.occupancy.wavefront import wavefront
from vsx_ros.occupancy.grid import FREE, OccupancyGrid

CLEARANCE_REACH_M = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Values (H, W) [m] at the middles of cells; origin_x, origin_y: outer corner of cell (0, 0) [m]."""

    values: FloatArray
    resolution: float
    origin_x: float
    origin_y: float

    def at(self, points_world: Points2) -> FloatArray:
        """(N,) bilinear values [m] at (N, 2) points; outside, the edge's value less the distance to it."""
        points = np.ascontiguousarray(points_world, float).reshape(-1, 2)
        return interpolate_many(self.values, self.resolution, self.origin_x, self.origin_y, points)

    def least_on(self, table: FloatArray, direction: int, step_m: float) -> float:
        """The least value [m] on a curve of knots (M, 5) s, x, y, theta, kappa, looked at every step_m."""
        return least_on_curve(
            self.values, self.resolution, self.origin_x, self.origin_y, np.ascontiguousarray(table), direction, step_m
        )

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell at a position [m]; may lie outside."""
        return math.floor((y - self.origin_y) / self.resolution), math.floor((x - self.origin_x) / self.resolution)

    def cells(self, points_world: Points2) -> tuple[IntArray, IntArray]:
        """Rows (N,) and columns (N,) of the cells at (N, 2) positions [m]; may lie outside."""
        x, y = np.asarray(points_world, float).reshape(-1, 2).T
        rows = np.floor((y - self.origin_y) / self.resolution).astype(np.int64)
        columns = np.floor((x - self.origin_x) / self.resolution).astype(np.int64)
        return rows, columns

    def gradient(self, points_world: Points2) -> FloatArray:
        """(N, 2) central differences over one cell [m/m]."""
        points = np.ascontiguousarray(points_world, float).reshape(-1, 2)
        return gradient_many(self.values, self.resolution, self.origin_x, self.origin_y, points)


def clearance_field(grid: OccupancyGrid, reach_m: float = CLEARANCE_REACH_M) -> DistanceField:
    """Distance to the nearest cell that is occupied, unknown or outside the map; negative inside such a cell.

    Distances go to the edges of the cells, exactly at the middles of cells, and are cut off at reach_m.
    """
    blocked = np.ones((grid.shape[0] + 2, grid.shape[1] + 2), np.bool_)
    blocked[1:-1, 1:-1] = grid.data != FREE
    values = signed_distance(blocked, math.ceil(reach_m / grid.resolution))
    values *= grid.resolution
    return DistanceField(values, grid.resolution, grid.origin_x - grid.resolution, grid.origin_y - grid.resolution)


def travel_distance(field: DistanceField, start: tuple[float, float]) -> FloatArray:
    """(H, W) length [m] of the shortest 8-connected way from start through cells whose field value is not negative.

    Infinite where there is none. The start's own cell is always entered.
    """
    open_cells: BoolArray = field.values >= 0.0
    row, column = field.cell(*start)
    if not (0 <= row < open_cells.shape[0] and 0 <= column < open_cells.shape[1]):
        return np.full(open_cells.shape, np.inf)
    distances = wavefront(open_cells, row, column)
    distances *= field.resolution
    return distances


def with_fringe(distances: FloatArray, resolution: float) -> FloatArray:
    """Travel distances (H, W) [m] carried one cell further into cells that are closed.

    A position can be open although the middle of its cell is not; its distance is that of the nearest cell beside it.
    """
    return fringe(np.ascontiguousarray(distances, float), resolution)
