"""The true rooms of a generated world, and how many of them a split ground map has found."""

from collections.abc import Sequence

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, IntArray, Points2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.sim.truth import fill
from vsx_ros.sim.world import World, signed_area

_RIGHT_RATIO = 0.8  # least intersection over union of a right room
_DOOR_M = 1.65  # a wider gap between two walls in line is no door


def room_truth(world: World, grid: OccupancyGrid) -> IntArray:
    """(H, W) the true rooms on the cells of a grid in the world's frame, numbered from 1; 0 in walls and outside. Doors
    are gaps between free-standing walls in line along an axis; furniture counts as ground."""
    solid = np.ones(grid.shape, np.uint8)
    corner, half = np.array([grid.origin_x, grid.origin_y]), 0.5 * grid.resolution
    for outline in world.outlines:
        loop = np.asarray(outline.points, float)
        fill(solid, (loop - corner) / grid.resolution, 0 if signed_area(loop) > 0 else 1)
    for a, b, thickness in _walls_with_doors_shut(world):
        low, high = np.minimum(a, b) - 0.5 * thickness - half, np.maximum(a, b) + 0.5 * thickness + half
        loop = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        fill(solid, (loop - corner) / grid.resolution, 1)
    return np.asarray(cv2.connectedComponents(1 - solid, connectivity=4)[1], np.int64)


def _walls_with_doors_shut(world: World) -> list[tuple[Points2, Points2, float]]:
    """Ends and thickness of each wall, and of what would shut each door."""
    walls = [(np.array(w.points[0]), np.array(w.points[-1]), w.thickness) for w in world.walls]
    shut = []
    for axis in (0, 1):
        along = [wall for wall in walls if abs(wall[0][1 - axis] - wall[1][1 - axis]) < 1e-9]
        for a, b, thickness in along:
            end = a if a[axis] > b[axis] else b
            starts = [c if c[axis] < d[axis] else d for c, d, _ in along if abs(c[1 - axis] - a[1 - axis]) < 1e-9]
            gaps = [(start[axis] - end[axis], start) for start in starts if 0.0 < start[axis] - end[axis] <= _DOOR_M]
            shut += [(end, min(gaps, key=lambda gap: gap[0])[1], thickness)] if gaps else []
    return walls + shut


def shared_ratio(a: BoolArray, b: BoolArray) -> float:
    """Intersection over union of two areas (H, W); 0 when both are empty."""
    union = int(np.count_nonzero(a | b))
    return float(np.count_nonzero(a & b)) / union if union else 0.0


def right_rooms(labels: IntArray, truth: IntArray) -> tuple[int, int]:
    """How many rooms of the truth (H, W) have a room of their own that is about the same area, and how
    many there are. Both count from 1; 0 is no room."""
    numbers: Sequence[int] = [int(number) for number in np.unique(truth) if number]
    right = 0
    for number in numbers:
        mine = truth == number
        found = np.bincount(labels[mine].ravel())
        found[0] = 0
        best = int(np.argmax(found))
        right += bool(found[best]) and shared_ratio(mine, labels == best) >= _RIGHT_RATIO
    return right, len(numbers)
