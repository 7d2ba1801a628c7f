"""The unknown ground: where known free space meets it (frontiers, paper 5.2), which of it can be seen from where, and
how much seeing it tells (information gain).

A sparse map shows a plain wall as a row of dots, and ground behind them stays unknown however often it is looked at.
So gaps in a long straight row of obstacle cells count as wall, and unknown cells lose information with every look at
them from the same side. From another side they keep it: what hid them may be a box.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points2
from vsx_ros.config import ExplorationConfig
from vsx_ros.kernels.occupancy.visibility import count_looks, weights_of_looks
from vsx_ros.occupancy.gaps import walls
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

SECTORS = 8  # of 45 deg: what was looked at in vain from one side keeps its worth from others
_WALL_THICKNESS = 2  # cells; rays slip through the corners of thinner lines


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


def opaque_walls(grid: OccupancyGrid, gap_m: float, wall_gap_m: float) -> OccupancyGrid:
    """The grid with unknown gaps between obstacle cells as obstacle: those narrower than gap_m [m] anywhere, those
    shorter than wall_gap_m [m] along straight walls."""
    solid = walls(grid.data == OCCUPIED, grid.resolution, gap_m, wall_gap_m, thickness=_WALL_THICKNESS)
    return replace(grid, data=np.where(solid & (grid.data == UNKNOWN), OCCUPIED, grid.data))


def information_weights(grid: OccupancyGrid, looked_from: FloatArray, config: ExplorationConfig) -> FloatArray:
    """(SECTORS, H, W) weight of each unknown cell: the information in a look from a sector of bearings, in (0, 1]; 0
    where the ground is known.

    Half for every ``looks_to_half`` looks in that sector from within ``look_range_m`` among the poses looked_from
    (N, 3); looks in the sectors beside it count half.
    """
    looks = count_looks(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, np.ascontiguousarray(looked_from).reshape(-1, 3),
        0.5 * config.sensor_fov_rad, config.look_range_m, SECTORS,
    )  # fmt: skip
    left: FloatArray = np.exp2(-0.5 * np.arange(2 * len(looked_from) + 1) / config.looks_to_half)
    return weights_of_looks(grid.data, looks, left)
