"""Which cells of a plane are believed (paper 5.1): first those with map points, then consistent neighbours of believed
cells. A cell without texture is believed only between believed ones, or where a plain wall meets the floor: there the
brightness has a step along the wall's base line, alike in most keyframes. This fills plain walls but not the gaps
between them: through a gap the floor continues."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config import DenseConfig
from vsx_ros.dense.planes import Plane
from vsx_ros.kernels.dense import floor_contact as kernels
from vsx_ros.kernels.dense.view_choice import Views

_SURELY_CARVED_VOTES = 4  # keyframes that look through a cell; fewer may come from wrong points behind it
_REACH = np.ones((5, 5), np.uint8)  # cells around believed ones: two to each side
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)  # the eight neighbours
_WEAK_NEIGHBOURS, _COMPANY = 2, 4  # believed ones of eight that a weak cell needs, and that a grown cell needs to stay
_HOLE_ROWS, _HOLE_COLUMNS = 4, 1  # cells; more is filled up and down a wall than along it, where doors are
_STRIPS_M = (0.025, 0.01, 0.05, 0.02, 0.08)  # half width; begin and end on the wall; begin and least length on floor
_SHIFTS_M = np.array([0.0, -0.3, -0.2, 0.2, 0.3])  # the foot itself, then well behind the wall and in front of it
_SHIFT_TOLERANCE = 0.1  # of the smallest step: noise makes equal steps differ by this much
_MAX_VIEWS, _GRAZING_COSINE = 24, 0.2  # to save time; the camera must look down at the floor, not along it
_MIN_RUN = 3  # adjacent columns of a wall's foot; fewer are chance


def grow_regions(seeds: BoolArray, strong: BoolArray, weak: BoolArray, passing: IntArray) -> BoolArray:
    """Cells (W, H) reached from the seeds: strong ones within two cells of believed ones, weak ones beside at least two
    believed ones. At the end, cells that are no seeds and almost isolated are dropped: they are chance matches in gaps.
    Cells that many keyframes look through are never believed."""
    open_cells = passing < _SURELY_CARVED_VOTES
    believed = seeds & open_cells
    while True:
        near = cv2.dilate(believed.astype(np.uint8), _REACH) > 0
        more = believed | (open_cells & ((strong & near) | (weak & (_neighbours(believed) >= _WEAK_NEIGHBOURS))))
        if (more == believed).all():
            break
        believed = more
    return np.asarray(believed & (seeds | (_neighbours(believed) >= _COMPANY)))


def _neighbours(mask: BoolArray) -> IntArray:
    """(W, H) how many of the eight cells around each are set."""
    around = cv2.filter2D(mask.astype(np.uint8), -1, _RING, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(around, np.int64)


def enclosed(believed: BoolArray, against: BoolArray) -> BoolArray:
    """Cells (W, H) in short holes between believed ones, up to four rows of one column or one column wide, that are
    neither believed nor ``against``."""
    holes: BoolArray = _between(believed, _HOLE_ROWS) | _between(believed.T, _HOLE_COLUMNS).T
    return holes & ~believed & ~against


def _between(believed: BoolArray, longest: int) -> BoolArray:
    """Cells with a believed one before and after them along the second axis, in holes of at most ``longest`` cells."""
    number = np.arange(believed.shape[1])
    before = np.maximum.accumulate(np.where(believed, number, -(longest + 2)), axis=1)
    after = np.where(believed, number, 2 * believed.shape[1] + longest)[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    return np.asarray((after - before - 1 <= longest) & (before >= 0))


class Contact(NamedTuple):
    """touches (C,): whether the wall meets the floor in each column. keyframe (C,): id of the nearest keyframe that
    shows it, -1 if none does. witnesses (C, W): ids of keyframes apart from each other that show it, too, -1 for the
    rest."""

    touches: BoolArray
    keyframe: NDArray[np.int64]
    witnesses: NDArray[np.int64]

    @staticmethod
    def none(columns: int) -> "Contact":
        """Columns that nothing is known of."""
        never = np.full((columns, kernels.WITNESSES), -1, np.int64)
        return Contact(np.zeros(columns, np.bool_), never[:, 0].copy(), never)


def floor_contact(views: Views, plane: Plane, columns: IntArray, config: DenseConfig) -> Contact:
    """Which columns touch the floor z = 0. columns (C,): numbers of a wall's cells along its right axis. The mean
    signed step over the views must be large enough, and not larger well in front of the wall or behind it."""
    feet = plane.points_at(np.stack([(columns + 0.5) * config.cell_m, np.zeros(len(columns))], axis=1))
    feet -= np.outer(feet[:, 2] / plane.axes[1, 2], plane.axes[1])
    front = plane.normal * np.array([1.0, 1.0, 0.0])
    front /= float(np.linalg.norm(front))
    limits = (config.min_range_m, config.max_range_m, _GRAZING_COSINE, config.contact_contrast, _MAX_VIEWS)
    seen, steps, reference, witnesses = kernels.contact_steps(
        views, feet, front, np.ascontiguousarray(plane.axes[0]), _STRIPS_M, _SHIFTS_M, limits
    )
    size = np.abs(steps)
    peak = size[:, 0] >= size[:, 1:].max(axis=1, initial=0.0) - _SHIFT_TOLERANCE
    touches = (seen >= config.contact_min_views) & (size[:, 0] >= config.contact_step) & peak
    ids = np.append(views.ids, -1)
    return Contact(touches, ids[reference].astype(np.int64), ids[witnesses].astype(np.int64))


def supported_runs(touches: BoolArray, support: BoolArray, config: DenseConfig) -> BoolArray:
    """(C,) runs of columns that touch the floor within reach of ``support`` (C,), the columns where the wall is seen.
    Holes of one column are closed; runs of fewer than three are dropped."""
    near = cv2.dilate(support.astype(np.uint8)[None], _reach(config)) > 0
    kept = np.pad((touches & near[0]).astype(np.uint8)[None], ((0, 0), (_MIN_RUN, _MIN_RUN)))
    kept = cv2.morphologyEx(kept, cv2.MORPH_CLOSE, np.ones((1, 3), np.uint8))
    kept = cv2.morphologyEx(kept, cv2.MORPH_OPEN, np.ones((1, _MIN_RUN), np.uint8))
    return np.asarray(kept[0, _MIN_RUN:-_MIN_RUN] > 0)


def fill_heights(accepted: BoolArray, runs: BoolArray, config: DenseConfig) -> FloatArray:
    """(C,) number of rows to fill from the floor up in the columns ``runs``; 0 in the others. It reaches the lowest
    accepted cell (C, H; row 0 on the floor) of the column or of one in reach, at most ``max_fill_height_m``."""
    limit, any_accepted = math.ceil(config.max_fill_height_m / config.cell_m), accepted.any(axis=1)
    lowest = np.where(any_accepted, accepted.argmax(axis=1), limit).astype(np.float32)
    near = cv2.erode(lowest[None], _reach(config), borderType=cv2.BORDER_REPLICATE)[0]
    own = np.where(any_accepted, lowest, near)
    return np.asarray(np.where(runs, np.minimum(np.maximum(own, 1.0), limit), 0.0).astype(np.float64))


def _reach(config: DenseConfig) -> NDArray[np.uint8]:
    """Kernel over the columns on either side that may support one."""
    return np.ones((1, 2 * math.floor(config.contact_max_support_m / config.cell_m) + 1), np.uint8)
