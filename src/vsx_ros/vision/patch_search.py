"""Map-point patches: cut them from a keyframe, find them in an image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.geometry.projection import unproject_pixels
from vsx_ros.kernels.vision.patches import CENTRE, PATCH, Target
from vsx_ros.kernels.vision.search import search, warp_templates
from vsx_ros.vision.corners import Corners
from vsx_ros.vision.pyramid import Pyramid


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


def to_level(uv: Pixels, level: int | IntArray) -> Pixels:
    """Level-0 pixels at a pyramid level."""
    scale = np.asarray(2.0 ** np.asarray(level, float)).reshape(-1, 1)
    return (uv + 0.5) / scale - 0.5


def from_level(uv: Pixels, level: int | IntArray) -> Pixels:
    """Pixels of a pyramid level at level 0."""
    scale = np.asarray(2.0 ** np.asarray(level, float)).reshape(-1, 1)
    return (uv + 0.5) * scale - 0.5


def target_of(pyramid: Pyramid, corners: Corners) -> Target:
    """An image as kernels search it."""
    return Target(*pyramid, corners.positions, corners.row_table)


class WarpedTemplates(NamedTuple):
    """How predicted points should appear: templates (S, 10, 10) int32, see ``warp_template``; usable (S,)."""

    templates: NDArray[np.int32]
    usable: BoolArray


def warped_templates(patches: NDArray[np.uint8], offsets: FloatArray, predictions: Predictions) -> WarpedTemplates:
    """The patches (T, 24, 24) with offsets (T, 2) of predicted points, as the predictions see them."""
    return WarpedTemplates(*warp_templates(patches, offsets, predictions.template, predictions.inverse_warp))


def search_templates(
    pyramid: Pyramid,
    corners: Corners,
    templates: WarpedTemplates,
    level: IntArray,
    uv: Pixels,
    radius_px: float,
    reach: int = 0,
    wanted: BoolArray | None = None,
) -> tuple[BoolArray, Pixels]:
    """(found (S,), position (S, 2) level-0 px) of looks near uv (S, 2) level-0 px: at corners within radius_px
    (level-0 px) and, where none fits, at any pixel within ``reach`` level px. wanted (S,): None means all usable."""
    usable = templates.usable if wanted is None else wanted & templates.usable
    return search(target_of(pyramid, corners), templates.templates, usable, level, uv, float(radius_px), reach)


def find_patches(
    pyramid: Pyramid,
    corners: Corners,
    patches: NDArray[np.uint8],
    offsets: FloatArray,
    predictions: Predictions,
    radius_px: float,
    reach: int = 0,
) -> tuple[BoolArray, Pixels]:
    """``search_templates`` of predicted points where they are predicted."""
    templates = warped_templates(patches, offsets, predictions)
    return search_templates(pyramid, corners, templates, predictions.level, predictions.uv, radius_px, reach)


def cut_patches(pyramid: Pyramid, positions: NDArray[np.int32], level: int) -> NDArray[np.uint8]:
    """(N, 24, 24) patches around integer level positions (N, 2), which must be at least 12 px from the border."""
    image = pyramid.level(level)
    windows = np.lib.stride_tricks.sliding_window_view(image, (PATCH, PATCH))
    return windows[positions[:, 1] - CENTRE, positions[:, 0] - CENTRE].copy()


class Rays(NamedTuple):
    """direction (N, 2) on the plane z = 1; basis (N, 4): its change by one level pixel right and down."""

    direction: FloatArray
    basis: FloatArray


def kernel_camera(camera: PinholeCamera) -> FloatArray:
    """(18,) camera array of the kernels of an image taken standing still, with the largest squared radius the image
    uses (plus 10 %)."""
    parameters = camera.parameters()
    w, h = camera.width - 1.0, camera.height - 1.0
    standing = np.zeros(6)
    border = np.array([[0, 0], [w, 0], [0, h], [w, h], [w / 2, 0], [w / 2, h], [0, h / 2], [w, h / 2]])
    plane = unproject_pixels(np.concatenate([parameters, [np.inf, w, h], standing]), border)
    r2_max = 1.21 * float((plane**2).sum(axis=1).max())
    return np.concatenate([parameters, [r2_max, camera.width, camera.height], standing])


def moving(camera: FloatArray, motion: FloatArray) -> FloatArray:
    """The camera array of an image during whose readout the camera moved: motion (6,), rotation vector [rad] and way
    [m] in its own frame."""
    return np.concatenate([camera[:-6], motion])


def cast_rays(camera: FloatArray, positions: NDArray[np.int32], level: int) -> Rays:
    """Viewing rays of integer level positions (N, 2); camera (18,) as ``kernel_camera`` gives it."""
    offsets = [np.array([0.0, 0.0]), np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    at, right, down = (
        unproject_pixels(camera, np.ascontiguousarray(from_level(positions + offset, level))) for offset in offsets
    )
    return Rays(at, np.concatenate([right - at, down - at], axis=1))
