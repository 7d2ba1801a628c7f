"""Which cells of a plane are believed: those with map points first, then, from neighbour to neighbour, those that look
consistent (paper 5.1). A cell without texture is believed only between believed ones."""

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config import DenseConfig

_REFUTED_ZNCC = 0.4
_REFUTED_TEXTURE = 5.0
_CARVED_VOTES = 1
_SURELY_CARVED_VOTES = 4
_REACH = np.ones((5, 5), np.uint8)
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)
_WEAK_NEIGHBOURS = 2
_COMPANY = 4
_HOLE_ROWS = 4
_HOLE_COLUMNS = 1


def consistent(
    texture: FloatArray, score: FloatArray, rival: FloatArray, views: IntArray, config: DenseConfig
) -> BoolArray:
    """Cells that look alike at the plane's depth and less so at others, in enough keyframes beside the reference."""
    alike = (texture >= config.min_texture) & (score >= config.accept_zncc)
    told: BoolArray = alike & (score > rival + config.rival_margin) & (views >= config.min_views)
    return told


def refuted(texture: FloatArray, score: FloatArray, views: IntArray, passing: IntArray) -> BoolArray:
    """Cells where the plane is not: textured and unlike, or looked through by any keyframe."""
    unlike = (texture >= _REFUTED_TEXTURE) & (views >= 3) & (score < _REFUTED_ZNCC)
    through: BoolArray = unlike | (passing >= _CARVED_VOTES)
    return through


def grow_regions(seeds: BoolArray, strong: BoolArray, weak: BoolArray, passing: IntArray) -> BoolArray:
    """Cells (W, H) reached from the seeds: strong ones within two cells of believed ones, weak ones beside at least two
    believed ones. Last, what is no seed and stands almost alone is dropped: chance matches in gaps do. Cells that many
    keyframes look through are never believed."""
    open_cells = passing < _SURELY_CARVED_VOTES
    believed = seeds & open_cells
    while True:
        near = cv2.dilate(believed.astype(np.uint8), _REACH) > 0
        more = believed | (open_cells & ((strong & near) | (weak & (_neighbours(believed) >= _WEAK_NEIGHBOURS))))
        if (more == believed).all():
            break
        believed = more
    kept: BoolArray = believed & (seeds | (_neighbours(believed) >= _COMPANY))
    return kept


def _neighbours(mask: BoolArray) -> IntArray:
    """(W, H) how many of the eight cells around each are set."""
    around = cv2.filter2D(mask.astype(np.uint8), -1, _RING, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(around, np.int64)


def enclosed(believed: BoolArray, against: BoolArray) -> BoolArray:
    """Cells (W, H), not believed and nothing ``against`` them, in short holes between believed ones: up to four rows
    of one column, or one column wide."""
    columns = _between(believed, _HOLE_ROWS)
    rows = _between(believed.T, _HOLE_COLUMNS).T
    holes: BoolArray = (columns | rows) & ~believed & ~against
    return holes


def _between(believed: BoolArray, longest: int) -> BoolArray:
    """Cells with a believed one before and after along the second axis, the hole at most ``longest`` cells."""
    number = np.arange(believed.shape[1])
    before = np.maximum.accumulate(np.where(believed, number, -(longest + 2)), axis=1)
    after = np.where(believed, number, 2 * believed.shape[1] + longest)[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    between: BoolArray = (after - before - 1 <= longest) & (before >= 0)
    return between
