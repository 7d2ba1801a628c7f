"""How much of the world the map holds, and how much of that is right."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, IntArray, Points2
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.line_of_sight import seen_cells
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

TOLERANCE_M = 0.10
_VIEWER_SPACING_CELLS = 4
_RAYS = 360


@dataclass(frozen=True)
class MapQuality:
    """A map against the truth. None where there is nothing to divide by.

    coverage: share of the observable cells that are known. coverage_correct: known and right; an occupied cell is right
    within 10 cm of an obstacle, a free cell is right if it is not deeper than that inside one.
    occupied_precision, occupied_recall: at 10 cm. free_inside_obstacle: share of the free cells more than 10 cm deep
    inside an obstacle.
    """

    coverage: float | None
    coverage_correct: float | None
    occupied_precision: float | None
    occupied_recall: float | None
    free_inside_obstacle: float | None


def observable_cells(truth: OccupancyGrid, start: SE2, robot_radius_m: float, sensor_range_m: float) -> BoolArray:
    """(H, W) mask of truth cells in sight, within range, of somewhere the robot can stand.

    start: where the robot begins, in the truth's frame. Raises InputError when it does not begin in free space.
    """
    standable = cv2.distanceTransform((truth.data == FREE).astype(np.uint8), cv2.DIST_L2, 5)
    standable = (standable * truth.resolution > robot_radius_m).astype(np.uint8)
    _, labels = cv2.connectedComponents(standable, connectivity=4)
    row, column = truth.cells(np.array([[start.x, start.y]]))[0]
    if not truth.contains(np.array([[row, column]]))[0] or labels[row, column] == 0:
        raise InputError(f"start ({start.x:.2f}, {start.y:.2f}) is not free in the true map; give the true start pose")
    viewers = np.argwhere(labels == labels[row, column])
    spaced = np.all(viewers % _VIEWER_SPACING_CELLS == 0, axis=1)
    viewers = np.vstack([viewers[spaced], [[row, column]]])
    seen = seen_cells(truth.data == OCCUPIED, viewers, sensor_range_m / truth.resolution, _RAYS)
    mask: BoolArray = seen & (truth.data != UNKNOWN)
    return mask


def map_quality(estimate: OccupancyGrid, truth: OccupancyGrid, observable: BoolArray, T_truth_map: SE2) -> MapQuality:
    """Judge a map. observable: (H, W) mask over the truth. T_truth_map: where the map's origin truly lies."""
    to_obstacle = metres_to(truth.data == OCCUPIED, truth)
    to_free = metres_to(truth.data == FREE, truth)
    cells = np.argwhere(observable)
    values = values_at(estimate, T_truth_map.inverse() @ truth.centres(cells))
    depth, gap = to_free[observable], to_obstacle[observable]
    known = values != UNKNOWN
    right = np.where(values == OCCUPIED, gap <= TOLERANCE_M, depth <= TOLERANCE_M) & known

    occupied = _truth_cells(estimate, OCCUPIED, truth, T_truth_map)
    free = _truth_cells(estimate, FREE, truth, T_truth_map)
    estimated = np.zeros(truth.shape, bool)
    estimated[occupied[:, 0], occupied[:, 1]] = True
    faces = observable & (truth.data == OCCUPIED)
    return MapQuality(
        coverage=share(known),
        coverage_correct=share(right),
        occupied_precision=share(to_obstacle[occupied[:, 0], occupied[:, 1]] <= TOLERANCE_M),
        occupied_recall=share(metres_to(estimated, truth)[faces] <= TOLERANCE_M),
        free_inside_obstacle=share(to_free[free[:, 0], free[:, 1]] > TOLERANCE_M),
    )


def share(hits: BoolArray) -> float | None:
    """Of a mask that is set; None of nothing."""
    return float(np.mean(hits)) if hits.size else None


def metres_to(cells: BoolArray, grid: OccupancyGrid) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """(H, W) distance [m] of each cell to the nearest of the given cells; infinite when there is none."""
    if not cells.any():
        return np.full(cells.shape, math.inf, np.float32)
    cells_away = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells_away * grid.resolution, np.float32)


def values_at(grid: OccupancyGrid, points: Points2) -> np.ndarray[tuple[int], np.dtype[np.int8]]:
    """(N,) the grid's values at (N, 2) points [m], UNKNOWN outside."""
    cells = grid.cells(points)
    inside = grid.contains(cells)
    values = np.full(len(cells), UNKNOWN, np.int8)
    values[inside] = grid.data[cells[inside, 0], cells[inside, 1]]
    return values


def _truth_cells(estimate: OccupancyGrid, value: int, truth: OccupancyGrid, T_truth_map: SE2) -> IntArray:
    """(N, 2) truth cells under the estimate's cells of the value; those outside of the truth are moved to its edge."""
    centres = T_truth_map @ estimate.centres(np.argwhere(estimate.data == value))
    cells = truth.cells(centres)
    return np.clip(cells, 0, np.array(truth.shape) - 1)
