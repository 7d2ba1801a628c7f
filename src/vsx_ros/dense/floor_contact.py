"""Where a wall without texture reaches the floor: the brightness steps along its base line, in most keyframes alike.

What fills plain walls without filling the gaps between them: through a gap the floor goes on.
"""

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

_STRIPS_M = (0.025, 0.01, 0.05, 0.02, 0.08)
_SHIFTS_M = np.array([0.0, -0.3, -0.2, 0.2, 0.3])
_SHIFT_TOLERANCE = 0.1
_MAX_VIEWS = 24
_GRAZING_COSINE = 0.2
_MIN_RUN = 3


class Contact(NamedTuple):
    """Of C columns: whether the wall meets the floor there, and in which keyframe (id, -1 where nobody looked) that
    was seen from nearest. All (C,)."""

    touches: BoolArray
    keyframe: NDArray[np.int64]


def floor_contact(views: Views, plane: Plane, columns: IntArray, config: DenseConfig) -> Contact:
    """Of columns (C,), numbers of a wall's cells along its right axis: which touch the floor z = 0. The step must be
    there in the mean over the views, all of one sign, and not be as large well in front of the wall or behind."""
    feet = plane.points_at(np.stack([(columns + 0.5) * config.cell_m, np.zeros(len(columns))], axis=1))
    feet -= np.outer(feet[:, 2] / plane.axes[1, 2], plane.axes[1])
    front = plane.normal * np.array([1.0, 1.0, 0.0])
    front /= float(np.linalg.norm(front))
    limits = (config.min_range_m, config.max_range_m, _GRAZING_COSINE, config.contact_contrast, _MAX_VIEWS)
    seen, steps, reference = kernels.contact_steps(
        views, feet, front, np.ascontiguousarray(plane.axes[0]), _STRIPS_M, _SHIFTS_M, limits
    )
    size = np.abs(steps)
    peak = size[:, 0] >= size[:, 1:].max(axis=1, initial=0.0) - _SHIFT_TOLERANCE
    touches = (seen >= config.contact_min_views) & (size[:, 0] >= config.contact_step) & peak
    ids = np.append(views.ids, -1)
    return Contact(touches, ids[reference].astype(np.int64))


def supported_runs(touches: BoolArray, support: BoolArray, config: DenseConfig) -> BoolArray:
    """(C,) columns in a row that touch the floor within reach of ``support`` (C,), columns where the wall is seen;
    holes of one column are closed, runs of fewer than three dropped."""
    reach = math.floor(config.contact_max_support_m / config.cell_m)
    near = cv2.dilate(support.astype(np.uint8)[None], np.ones((1, 2 * reach + 1), np.uint8)) > 0
    kept = (touches & near[0]).astype(np.uint8)[None]
    kept = np.pad(kept, ((0, 0), (_MIN_RUN, _MIN_RUN)))
    kept = cv2.morphologyEx(kept, cv2.MORPH_CLOSE, np.ones((1, 3), np.uint8))
    kept = cv2.morphologyEx(kept, cv2.MORPH_OPEN, np.ones((1, _MIN_RUN), np.uint8))
    runs: BoolArray = kept[0, _MIN_RUN:-_MIN_RUN] > 0
    return runs


def fill_heights(accepted: BoolArray, runs: BoolArray, config: DenseConfig) -> FloatArray:
    """(C,) rows to fill from the floor up in columns that touch it: to the lowest accepted cell (C, H; row 0 on the
    floor) in the column or one in reach, at most ``max_fill_height_m``; 0 in the others."""
    limit = math.ceil(config.max_fill_height_m / config.cell_m)
    lowest = np.where(accepted.any(axis=1), accepted.argmax(axis=1), limit).astype(np.float32)
    reach = math.floor(config.contact_max_support_m / config.cell_m)
    near = cv2.erode(lowest[None], np.ones((1, 2 * reach + 1), np.uint8), borderType=cv2.BORDER_REPLICATE)[0]
    own = np.where(accepted.any(axis=1), lowest, near)
    filled: FloatArray = np.where(runs, np.minimum(np.maximum(own, 1.0), limit), 0.0).astype(np.float64)
    return filled
