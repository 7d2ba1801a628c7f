"""Which cells a robot could ever see: the denominator of coverage."""

from __future__ import annotations

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.observable import mark_seen
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid

VIEW_SPACING_M = 0.2


def reachable_cells(grid: OccupancyGrid, start: SE2, robot_radius: float) -> BoolArray:
    """(H, W) cells the robot's middle can get to from the start, radius in metres; empty when it does not fit there."""
    free = np.pad(grid.data == FREE, 1).astype(np.uint8)
    clearance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * grid.resolution
    fits = (clearance > robot_radius).astype(np.uint8)
    _, labels = cv2.connectedComponents(fits, connectivity=4)
    row, column = grid.cells(np.array([[start.x, start.y]]))[0]
    inside = 0 <= row < fits.shape[0] and 0 <= column < fits.shape[1]
    if not inside or labels[row, column] == 0:
        return np.zeros(fits.shape, np.bool_)
    return np.asarray(labels == labels[row, column], np.bool_)


def observable_cells(grid: OccupancyGrid, start: SE2, robot_radius: float, range_m: float) -> BoolArray:
    """(H, W) free and occupied cells of the true grid that lie in view, within range_m, of some reachable place.

    Looking all round from places 0.2 m apart, at the height of the grid.
    """
    reach = reachable_cells(grid, start, robot_radius)
    step = max(1, round(VIEW_SPACING_M / grid.resolution))
    lattice = np.zeros_like(reach)
    lattice[::step, ::step] = True
    views = np.argwhere(reach & lattice)
    if len(views) == 0:
        views = np.argwhere(reach)
    seen = np.zeros(reach.shape, np.bool_)
    mark_seen(np.ascontiguousarray(grid.data == OCCUPIED), views, range_m / grid.resolution, seen)
    return np.asarray(seen & ((grid.data == FREE) | (grid.data == OCCUPIED)), np.bool_)
