"""What there is to find out: which unknown ground can be seen from where, and what seeing it is worth.

A sparse map shows a plain wall as a row of dots, and ground behind them stays unknown however often it is looked at.
So gaps between obstacles that lie in a line count as wall, and unknown cells lose their worth with every look at them
from the same side. From another side they keep it: what hid them may be a box.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ExplorationConfig
from vsx_ros.kernels.visibility import count_looks
from vsx_ros.occupancy.grid import OCCUPIED, UNKNOWN, OccupancyGrid

SECTORS = 8
_LINES = 12


def opaque_walls(grid: OccupancyGrid, gap_m: float, wall_gap_m: float) -> OccupancyGrid:
    """The grid with unknown gaps between obstacle cells as obstacle: those narrower than gap_m [m] anywhere, those
    narrower than wall_gap_m [m] where obstacles lie on one line with them."""
    occupied = (grid.data == OCCUPIED).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_odd_cells(gap_m, grid), _odd_cells(gap_m, grid)))
    cells = _odd_cells(wall_gap_m, grid)
    padded = cv2.copyMakeBorder(occupied, cells, cells, cells, cells, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)
    for k in range(_LINES):
        closed |= cv2.morphologyEx(padded, cv2.MORPH_CLOSE, _line(cells, math.pi * k / _LINES))
    inside = closed[cells:-cells, cells:-cells] > 0
    data = np.where(inside & (grid.data == UNKNOWN), OCCUPIED, grid.data).astype(np.int8)
    return OccupancyGrid(data, grid.resolution, grid.origin_x, grid.origin_y)


def unknown_worth(grid: OccupancyGrid, looked_from: FloatArray, config: ExplorationConfig) -> FloatArray:
    """(SECTORS, H, W) what finding out each unknown cell by a look in a sector of bearings is worth, in (0, 1].

    Half for every ``looks_to_half`` looks in that sector from within ``look_range_m`` among the poses looked_from
    (N, 3); looks in the sectors beside it count half.
    """
    looks = count_looks(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, np.ascontiguousarray(looked_from).reshape(-1, 3),
        0.5 * config.sensor_fov_rad, config.look_range_m, SECTORS,
    )  # fmt: skip
    smooth = looks + 0.5 * (np.roll(looks, 1, axis=0) + np.roll(looks, -1, axis=0))
    worth: FloatArray = np.exp2(-smooth / config.looks_to_half)
    return worth


def _odd_cells(width_m: float, grid: OccupancyGrid) -> int:
    return max(1, round(width_m / grid.resolution)) | 1


def _line(cells: int, angle: float) -> NDArray[np.uint8]:
    """(cells, cells) a line through the middle."""
    element = np.zeros((cells, cells), np.uint8)
    middle = cells // 2
    dx, dy = round(middle * math.cos(angle)), round(middle * math.sin(angle))
    cv2.line(element, (middle - dx, middle - dy), (middle + dx, middle + dy), 1)
    return element
