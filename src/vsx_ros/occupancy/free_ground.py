"""The free ground's gaps and rims: what sparse rays leave open in it, and what of it too few rays passed."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Int32Array
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN

_SPECK_CELLS, _SLIT_CELLS = 3, 7
MIN_SURE_VOTES = 2
"""So many keyframes know a cell at the rim of the free ground, or around a gap in it; where fewer do, it may be a
face's that they graze, and the gap the shadow of a leg."""


def gaps(data: NDArray[np.int8], sure: BoolArray) -> BoolArray:
    """Unknown cells in gaps of at most two cells between free ones, two cells or more from any obstacle; and unknown
    patches at most three cells wide and high whose every neighbour is free. Sparse rays leave both everywhere. Only
    ``sure`` free cells count."""
    free = np.pad(((data == FREE) & sure).astype(np.uint8), 2)
    closed = cv2.morphologyEx(free, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))[2:-2, 2:-2] > 0
    near_obstacle = cv2.dilate((data == OCCUPIED).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    found: BoolArray = closed & (data == UNKNOWN) & ~near_obstacle
    unknown = ((data == UNKNOWN) & ~found).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(unknown, connectivity=8)
    small = (stats[:, cv2.CC_STAT_WIDTH] <= _SPECK_CELLS) & (stats[:, cv2.CC_STAT_HEIGHT] <= _SPECK_CELLS)
    small[0] = False
    doubtful = cv2.dilate(((data == FREE) & ~sure).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    for beside in (labels[near_obstacle | doubtful], labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        small[beside] = False
    found |= small[labels]
    return found


def rims(data: NDArray[np.int8], free_votes: Int32Array) -> BoolArray:
    """Free cells beside obstacles, and beside what nobody saw, that few keyframes looked through: a ray along a face
    passes through the face's own cells, and what nobody saw may be a face. Unknown slits narrower than seven cells
    between free ones are not meant: they are where rays happen to lie apart."""
    free = np.pad((data == FREE).astype(np.uint8), _SLIT_CELLS)
    square = np.ones((_SLIT_CELLS, _SLIT_CELLS), np.uint8)
    closed = cv2.morphologyEx(free, cv2.MORPH_CLOSE, square)[_SLIT_CELLS:-_SLIT_CELLS, _SLIT_CELLS:-_SLIT_CELLS]
    beyond = (closed == 0) | (data == OCCUPIED)
    found: BoolArray = (data == FREE) & (free_votes < MIN_SURE_VOTES)
    found &= cv2.dilate(beyond.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return found
