"""The unknown ground: gaps between sparse rays, rims of the free ground that too few rays passed, partly mapped
obstacles. Frontiers, where free space meets unknown ground (paper 5.2), and the information of a view.

A sparse map shows a plain wall as a row of dots, and the ground behind them stays unknown even after many looks. So
gaps in a long straight row of obstacle cells count as wall, and unknown cells lose information with every look from the
same side. From another side they keep it: a box may have hidden them."""

import math
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray, Points2
from vsx_ros.config import ExplorationConfig
from vsx_ros.kernels.occupancy.visibility import Looks, count_half_looks
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.zoned_grid import ZonedGrid

_ROW_CELLS, WALL_ROW_M, _ROW_STEP_RAD = 12, 1.0, math.pi / 90
"""A line with this many obstacle cells and this length is a wall; angular step of the search for it."""
_SPECK_CELLS, _SLIT_CELLS = 3, 7  # 15 and 35 cm at 5 cm per cell: the distance of rays; too narrow for a robot
MIN_SURE_VOTES = 2
"""Keyframes that must see a cell at the rim of the free ground, or around a gap in it. With fewer, the cell may belong
to a face that the rays graze, and the gap may be the shadow of a leg."""
SECTORS = 8  # of 45 deg: a cell seen from one side without result keeps its value for the others
_WALL_THICKNESS = 2  # cells; rays slip through the corners of thinner lines


def gaps(data: NDArray[np.int8], sure: BoolArray) -> BoolArray:
    """Unknown cells in gaps of at most two cells between free ones, more than two cells from any obstacle; and unknown
    patches at most three cells wide and high whose neighbours are all free. Sparse rays leave both everywhere. Only
    ``sure`` free cells count."""
    free = np.pad(((data == FREE) & sure).astype(np.uint8), 2)
    closed = cv2.morphologyEx(free, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))[2:-2, 2:-2] > 0
    near_obstacle = cv2.dilate((data == OCCUPIED).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    found: BoolArray = closed & (data == UNKNOWN) & ~near_obstacle
    unknown = ((data == UNKNOWN) & ~found).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(unknown, connectivity=8)
    small = (stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]] <= _SPECK_CELLS).all(axis=1)
    small[0] = False
    doubtful = cv2.dilate(((data == FREE) & ~sure).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    for beside in (labels[near_obstacle | doubtful], labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        small[beside] = False
    found |= small[labels]
    return found


def rims(data: NDArray[np.int8], free_votes: Int32Array) -> BoolArray:
    """Free cells beside obstacles or unseen cells that few keyframes looked through. A ray along a face passes through
    the face's own cells, and unseen cells may be a face. Unknown slits narrower than seven cells between free ones do
    not count: they are only gaps between rays."""
    free = np.pad((data == FREE).astype(np.uint8), _SLIT_CELLS)
    square = np.ones((_SLIT_CELLS, _SLIT_CELLS), np.uint8)
    closed = cv2.morphologyEx(free, cv2.MORPH_CLOSE, square)[_SLIT_CELLS:-_SLIT_CELLS, _SLIT_CELLS:-_SLIT_CELLS]
    beyond = (closed == 0) | (data == OCCUPIED)
    found: BoolArray = (data == FREE) & (free_votes < MIN_SURE_VOTES)
    found &= cv2.dilate(beyond.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return found


def walls(
    occupied: BoolArray, resolution: float, narrow_m: float, gap_m: float, share: float = 0.0, thickness: int = 1
) -> BoolArray:
    """(H, W) obstacle cells and their gaps: gaps narrower than narrow_m [m] anywhere, gaps shorter than gap_m [m] in
    straight rows. share: least part of a row that is obstacle; with less, it may be separate things in line. thickness:
    of the rows [cells]; rays slip through the corners of thin ones."""
    cells = occupied.astype(np.uint8)
    width = max(1, round(narrow_m / resolution)) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    padded = cv2.copyMakeBorder(cells, width, width, width, width, cv2.BORDER_CONSTANT, value=0)
    closed = np.ascontiguousarray(cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[width:-width, width:-width])
    lines = cv2.HoughLinesP(
        255 * cells, 1.0, _ROW_STEP_RAD, _ROW_CELLS,
        minLineLength=WALL_ROW_M / resolution, maxLineGap=gap_m / resolution,
    )  # fmt: skip
    beside = cv2.dilate(cells, np.ones((3, 3), np.uint8))
    for x0, y0, x1, y1 in lines.reshape(-1, 4).tolist() if lines is not None else []:
        n = max(abs(x1 - x0), abs(y1 - y0)) + 1
        rows, columns = np.rint(np.linspace((y0, x0), (y1, x1), n)).astype(int).T
        if beside[rows, columns].mean() >= share:
            cv2.line(closed, (x0, y0), (x1, y1), 1, thickness)
    return closed > 0


class Frontier(NamedTuple):
    """A connected border of free cells that touch unknown ones.

    cells: (K, 2) row, column. centroid: (2,) mean position [m]. length_m: K cells as a length [m]."""

    cells: IntArray
    centroid: Points2
    length_m: float


def find_frontiers(grid: OccupancyGrid, min_length_m: float) -> list[Frontier]:
    """The frontiers of a grid, longest first, without those shorter than min_length_m [m]."""
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
    """The grid with unknown gaps between obstacle cells set to obstacle: gaps narrower than gap_m [m] anywhere, gaps
    shorter than wall_gap_m [m] along straight walls."""
    solid = walls(grid.data == OCCUPIED, grid.resolution, gap_m, wall_gap_m, thickness=_WALL_THICKNESS)
    return replace(grid, data=np.where(solid & (grid.data == UNKNOWN), OCCUPIED, grid.data))


def looks_so_far(grid: OccupancyGrid, looked_from: FloatArray, config: ExplorationConfig) -> Looks:
    """The looks at each cell from SECTORS sectors of bearings, and the information in another, a weight in (0, 1].

    Every ``looks_to_half`` looks in a sector from within ``look_range_m``, among the poses looked_from (N, 3), halve
    the weight. Looks in the two adjacent sectors count half. Ground outside the zones to look into has no weight."""
    halves = count_half_looks(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, np.ascontiguousarray(looked_from).reshape(-1, 3),
        0.5 * config.sensor_fov_rad, config.look_range_m, SECTORS,
    )  # fmt: skip
    left: FloatArray = np.exp2(-0.5 * np.arange(2 * len(looked_from) + 1) / config.looks_to_half)
    wanted = grid.zones.wanted if isinstance(grid, ZonedGrid) else None
    return Looks(halves, left, np.ones(grid.shape, np.bool_) if wanted is None else np.array(wanted))
