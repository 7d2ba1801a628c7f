"""How far one is from what is not known to be free, and how far it is to drive."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.kernels.occupancy.clearance import DistanceField, fringe, signed_distance
from vsx_ros.kernels.occupancy.wavefront import wavefront
from vsx_ros.occupancy.grid import FREE, OccupancyGrid

CLEARANCE_REACH_M = 1.5


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
