"""Information gain: which unknown ground can be seen from where, and how much seeing it tells.

A sparse map shows a plain wall as a row of dots, and ground behind them stays unknown however often it is looked at.
So gaps in a long straight row of obstacle cells count as wall, and unknown cells lose information with every look at
them from the same side. From another side they keep it: what hid them may be a box.
"""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ExplorationConfig
from vsx_ros.kernels.occupancy.visibility import count_looks, weights_of_looks
from vsx_ros.occupancy.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.walls import walls

SECTORS = 8
_WALL_THICKNESS = 2
"""Cells; rays slip through the corners of thinner lines."""


def opaque_walls(grid: OccupancyGrid, gap_m: float, wall_gap_m: float) -> OccupancyGrid:
    """The grid with unknown gaps between obstacle cells as obstacle: those narrower than gap_m [m] anywhere, those
    shorter than wall_gap_m [m] along straight walls."""
    solid = walls(grid.data == OCCUPIED, grid.resolution, gap_m, wall_gap_m, thickness=_WALL_THICKNESS)
    data = np.where(solid & (grid.data == UNKNOWN), OCCUPIED, grid.data).astype(np.int8)
    return OccupancyGrid(data, grid.resolution, grid.origin_x, grid.origin_y)


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
