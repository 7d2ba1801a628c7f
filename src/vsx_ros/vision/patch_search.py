"""Map-point patches: cut them from a keyframe, find them in an image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.kernels.lens import MOTION
from vsx_ros.kernels.vision.patches import CENTRE, PATCH, Target
from vsx_ros.kernels.vision.search import search, warp_templates
from vsx_ros.vision.corners import Corners, PackedCorners
from vsx_ros.vision.pyramid import Pyramid, from_level


class Predictions(NamedTuple):
    """Visible map points: rows (S,), level (S,), uv (S, 2) level-0 px, inverse_warp (S, 4), template (S,)."""

    rows: IntArray
    level: IntArray
    uv: Pixels
    inverse_warp: FloatArray
    template: IntArray

    def take(self, chosen: IntArray | BoolArray) -> Predictions:
        """A subset, by index or mask."""
        return Predictions._make(column[chosen] for column in self)


def target_of(pyramid: Pyramid, corners: Corners | PackedCorners) -> Target:
    """An image in the form that kernels search."""
    return Target(*pyramid, corners.positions, corners.row_table)


def find_patches(
    target: Target,
    patches: NDArray[np.uint8],
    offsets: FloatArray,
    predictions: Predictions,
    radius_px: float,
    reach: int = 0,
) -> tuple[BoolArray, Pixels]:
    """Search for predicted points by patches (T, 24, 24) with offsets (T, 2): at corners within radius_px (level-0 px)
    and, where none fits, at any pixel within ``reach`` level px. Returns found (S,), position (S, 2) level-0 px."""
    templates, usable = warp_templates(patches, offsets, predictions.template, predictions.inverse_warp)
    return search(target, templates, usable, predictions.level, predictions.uv, float(radius_px), reach)


def cut_patches(pyramid: Pyramid, positions: NDArray[np.int32], level: int) -> NDArray[np.uint8]:
    """(N, 24, 24) patches around integer level positions (N, 2), which must be at least 12 px from the border."""
    image = pyramid.level(level)
    if min(image.shape) < PATCH:  # the coarsest level of a small image: no position is so far from the border
        return np.zeros((0, PATCH, PATCH), np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(image, (PATCH, PATCH))
    return windows[positions[:, 1] - CENTRE, positions[:, 0] - CENTRE].copy()


def moving(camera: FloatArray, motion: FloatArray) -> FloatArray:
    """The camera array with motion during readout. motion (6,): rotation vector [rad], translation [m] in its frame."""
    moved = camera.copy()
    moved[MOTION : MOTION + 6] = motion
    return moved


def cast_rays(camera: FloatArray, positions: NDArray[np.int32], level: int) -> tuple[FloatArray, FloatArray]:
    """Viewing rays (N, 2) on the plane z = 1 of integer level positions (N, 2), and their change (N, 4) by one level
    pixel right and down. camera (CAMERA,): as ``kernel_camera`` gives it."""
    offsets = [np.array([0.0, 0.0]), np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    at, right, down = (
        unproject_pixels(camera, np.ascontiguousarray(from_level(positions + offset, level))) for offset in offsets
    )
    return at, np.concatenate([right - at, down - at], axis=1)
