"""New map points: strong corners of a keyframe, found again along their rays in two or three neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.geometry.camera import usable
from vsx_ros.geometry.epipolar import reprojection_error, triangulate
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import ideal_pixels, unproject_pixels
from vsx_ros.kernels.lens import HEIGHT, WIDTH
from vsx_ros.kernels.slam.epipolar import search_rays
from vsx_ros.kernels.vision.patches import CENTRE
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.vision.corners import strongest
from vsx_ros.vision.patch_search import cast_rays, cut_patches
from vsx_ros.vision.pyramid import LEVELS, from_level, to_level

_SHARE = (0.40, 0.30, 0.20, 0.10)  # of the new points by level: fine ones are precise, coarse ones visible from afar
_SPACING_PX = (10, 8, 6, 5)  # px of the level between corners, so that points spread over the image
_MAX_ERROR_PX = 2.0  # px of the level: largest reprojection error of a new point
NEAREST_M = 0.1  # nothing is nearer to a camera on a robot; avoids division by zero


class Candidates(NamedTuple):
    """Corners without a depth: uv (C, 2) level-0 px, level (C,), rays (C, 2), basis (C, 4), patches (C, 24, 24)."""

    uv: FloatArray
    level: IntArray
    rays: FloatArray
    basis: FloatArray
    patches: NDArray[np.uint8]

    def where(self, mask: BoolArray) -> Candidates:
        """The candidates where the mask is set."""
        return Candidates._make(column[mask] for column in self)


class TargetMatches(NamedTuple):
    """Candidates (chosen: indices) found in a target keyframe: where, and the points (n, 3) in the world."""

    chosen: IntArray
    uv: FloatArray
    level: IntArray
    points_world: Points3


def observations_at(
    data: FrameData, T_world_cam: SE3, points: Points3, rows: IntArray, uv: FloatArray, level: IntArray
) -> Observations:
    """Observations of points (P, 3) world, only ``rows``, at level-0 pixels of an image taken at a pose."""
    depth = np.maximum((points[rows] - T_world_cam.translation) @ T_world_cam.rotation[:, 2], NEAREST_M)
    ideal = ideal_pixels(data.camera, np.ascontiguousarray(uv), depth)
    return Observations(np.asarray(rows, np.int64), uv, ideal, np.asarray(level, np.int64))


def candidates_in(keyframe: KeyFrame, budget: int) -> Candidates:
    """The strongest corners of every level that are not near an observation of the same or the next coarser level."""
    parts, pyramid, observed = [], keyframe.data.pyramid, keyframe.observations
    for level in range(LEVELS):
        image, radius = pyramid.level(level), _SPACING_PX[level]
        occupied = masked(keyframe.data.camera, level, image.shape)
        near = observed.uv[(observed.level == level) | (observed.level == level + 1)]
        for x, y in np.rint(to_level(near, level)).astype(int):
            occupied[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1] = True
        corners = strongest(image, occupied, int(budget * _SHARE[level]), radius)
        uv, levels = from_level(corners.astype(float), level), np.full(len(corners), level, np.int64)
        rays, patches = cast_rays(keyframe.data.camera, corners, level), cut_patches(pyramid, corners, level)
        parts.append((uv, levels, *rays, patches))
    return Candidates._make(np.concatenate(column) for column in zip(*parts))


def masked(camera: FloatArray, level: int, shape: tuple[int, ...]) -> BoolArray:
    """(H, W) mask of the pixels of a level at which the lens model is not valid."""
    right, bottom = camera[[WIDTH, HEIGHT]] - 1.0
    if usable(camera, np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])).all():
        return np.zeros(shape, np.bool_)
    v, u = np.mgrid[: shape[0], : shape[1]]
    return ~usable(camera, from_level(np.column_stack([u.ravel(), v.ravel()]), level)).reshape(shape)


def match_in_target(
    source: KeyFrame,
    target: KeyFrame,
    candidates: Candidates,
    depth_range: tuple[float, float],
    min_parallax_rad: float,
) -> TargetMatches:
    """Search the candidates of ``source`` in ``target`` between two depths [m] and triangulate with checks: parallax,
    depth inside the range, reprojection within 2 level px in both."""
    T_target_source = target.T_world_cam.inverse() @ source.T_world_cam
    camera, n = target.data.camera, len(candidates.uv)
    tolerance = _MAX_ERROR_PX / camera[:2].min()  # of the shorter focal length
    bounds = np.tile([1.0 / depth_range[1], 1.0 / depth_range[0]], (n, 1))
    found, uv, level = search_rays(
        camera, T_target_source.rotation, T_target_source.translation, candidates.rays, candidates.basis,
        candidates.patches, bounds, target.data.target,
    )  # fmt: skip
    index = np.flatnonzero(found)
    uv, level = uv[index], level[index]
    points, keep = checked_points(
        T_target_source,
        candidates.rays[index],
        unproject_pixels(camera, uv),
        (tolerance * 2.0 ** candidates.level[index], tolerance * 2.0**level),
        depth_range,
        min_parallax_rad,
    )
    return TargetMatches(index[keep], uv[keep], level[keep], source.T_world_cam @ points[keep])


def checked_points(
    T_b_a: SE3,
    rays_a: FloatArray,
    rays_b: FloatArray,
    tolerance: tuple[FloatArray | float, FloatArray | float],
    depth_range: tuple[float, float],
    min_parallax_rad: float,
) -> tuple[Points3, BoolArray]:
    """Triangulated points (N, 3) in camera a, and which (N,) pass the checks of parallax, depth and errors [z = 1]."""
    points, parallax = triangulate(T_b_a, rays_a, rays_b)
    depth = points[:, 2]
    keep = (parallax >= min_parallax_rad) & (depth > depth_range[0]) & (depth < depth_range[1])
    keep &= reprojection_error(T_b_a, points, rays_b) < tolerance[1]
    keep &= reprojection_error(SE3.identity(), points, rays_a) < tolerance[0]
    return points, keep


def templates_in(keyframe: KeyFrame, chosen: IntArray) -> tuple[IntArray, NewTemplates]:
    """(those observations ``chosen`` (indices) of a keyframe that have a whole patch, their templates)."""
    observed = keyframe.observations
    kept, parts = [], []
    for level in range(LEVELS):
        index = chosen[observed.level[chosen] == level]
        at = to_level(observed.uv[index], level)
        whole = np.rint(at).astype(np.int32)
        height, width = keyframe.data.pyramid.level(level).shape
        inside = ((whole >= CENTRE) & (whole < np.array([width, height]) - CENTRE)).all(axis=1)
        index, at, whole = index[inside], at[inside], whole[inside]
        _, basis = cast_rays(keyframe.data.camera, whole, level)
        kept.append(index)
        parts.append((basis, at - whole, cut_patches(keyframe.data.pyramid, whole, level)))
    return np.concatenate(kept), NewTemplates(*(np.concatenate(column) for column in zip(*parts)))
