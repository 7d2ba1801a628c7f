"""Clearance from cells not known to be free, driving distances, and visible landmarks."""

import math

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField, signed_distance, wavefront
from vsx_ros.kernels.occupancy.visibility import visible_landmarks
from vsx_ros.occupancy.grid import OccupancyGrid

CLEARANCE_REACH_M = 1.5  # farther obstacles change no plan but cost time
GIVE_M = 0.02  # tolerance below the clearance where the base stands: interpolation near start and goal
_ESCAPE_M, _ESCAPE_SLOPE = 0.3, 2.0  # distance until the full need holds again; extra distance per missing metre


def clearance_field(grid: OccupancyGrid, reach_m: float = CLEARANCE_REACH_M) -> DistanceField:
    """Distance to the nearest cell that is occupied, unknown, closed by a zone or outside the map; negative inside it.

    Distances are to the cells' edges, exact at the centres of cells, and limited to reach_m."""
    blocked = np.ones((grid.shape[0] + 2, grid.shape[1] + 2), np.bool_)
    blocked[1:-1, 1:-1] = ~grid.drivable
    values = signed_distance(blocked, math.ceil(reach_m / grid.resolution))
    values *= grid.resolution
    return DistanceField(values, grid.resolution, grid.origin_x - grid.resolution, grid.origin_y - grid.resolution)


def relax_need(needed_m: FloatArray, field: DistanceField, pose: SE2, need_m: float) -> None:
    """Lower the needed clearance (H, W) around a pose with less; it rises to the full need away from it (in place)."""
    have_m = float(field.at(np.array([[pose.x, pose.y]]))[0]) - GIVE_M
    if have_m >= need_m:
        return
    escape_m = _ESCAPE_M + _ESCAPE_SLOPE * (need_m - have_m)
    x = field.origin_x + (np.arange(needed_m.shape[1]) + 0.5) * field.resolution - pose.x
    y = field.origin_y + (np.arange(needed_m.shape[0]) + 0.5) * field.resolution - pose.y
    # The ramp starts a cell away, so that interpolation cannot lift the need at the pose itself.
    away_m = np.maximum(np.hypot(x[None, :], y[:, None]) - math.sqrt(2.0) * field.resolution, 0.0)
    np.minimum(needed_m, have_m + (need_m - have_m) * away_m / escape_m, out=needed_m)


def travel_distance(field: DistanceField, start: tuple[float, float]) -> FloatArray:
    """(H, W) length [m] of the shortest 8-connected path from start through cells whose field value is not negative.

    Infinite where there is none. The path may always use the start's own cell."""
    open_cells: BoolArray = field.values >= 0.0
    row, column = field.cell(*start)
    if not (0 <= row < open_cells.shape[0] and 0 <= column < open_cells.shape[1]):
        return np.full(open_cells.shape, np.inf)
    distances = wavefront(open_cells, row, column)
    distances *= field.resolution
    return distances


def with_fringe(distances: FloatArray, resolution: float) -> FloatArray:
    """Travel distances (H, W) [m] extended by one cell into closed cells.

    A position can be open although the centre of its cell is not. Its distance is one cell more than the least of the
    neighbours'."""
    least_around = cv2.erode(np.asarray(distances, float), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
    return np.where(np.isinf(distances), least_around + resolution, distances)


def joined_distance(field: DistanceField, start: tuple[float, float]) -> FloatArray:
    """``travel_distance``, then ``with_fringe``."""
    return with_fringe(travel_distance(field, start), field.resolution)


def landmarks_in_view(
    grid: OccupancyGrid, poses: FloatArray, landmarks_world: FloatArray, half_fov_rad: float,
    range_m: tuple[float, float], most: int,
) -> IntArray:  # fmt: skip
    """(N,) how many landmarks (M, 2 or 3) [m] each pose (N, 3) would see within range_m (least, greatest), estimated
    from at most ``most`` of them."""
    stride = -(-len(landmarks_world) // most) or 1
    sample = np.ascontiguousarray(landmarks_world[::stride, :2], np.float64).reshape(-1, 2)
    return stride * visible_landmarks(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, np.ascontiguousarray(poses, np.float64), sample,
        half_fov_rad, *range_m,
    )  # fmt: skip
