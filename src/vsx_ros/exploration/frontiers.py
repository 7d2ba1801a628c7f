"""Frontiers: where known free space meets the unknown (paper 5.2)."""

from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import IntArray, Points2
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid


class Frontier(NamedTuple):
    """A connected border of free cells that touch unknown ones.

    cells: (K, 2) row, column. centroid: (2,) mean position [m]. length_m: K cells as a length [m].
    """

    cells: IntArray
    centroid: Points2
    length_m: float


def find_frontiers(grid: OccupancyGrid, min_length_m: float) -> list[Frontier]:
    """The frontiers of a grid, longest first; shorter ones than min_length_m [m] are left out."""
    unknown = (grid.data == UNKNOWN).astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    border = (grid.data == FREE) & (cv2.dilate(unknown, cross) > 0)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(border.astype(np.uint8), connectivity=8)
    frontiers = []
    for label, (left, top, width, height, size) in enumerate(stats.tolist()):
        if label and size * grid.resolution >= min_length_m:
            inside = labels[top : top + height, left : left + width] == label
            cells = np.argwhere(inside) + (top, left)
            frontiers.append(Frontier(cells, grid.centres(cells).mean(axis=0), size * grid.resolution))
    return sorted(frontiers, key=lambda f: -f.length_m)
