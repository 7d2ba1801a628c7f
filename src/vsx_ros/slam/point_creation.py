"""New map points: strong corners of a keyframe, found again along their rays in two or three neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.geometry.epipolar import reprojection_error, triangulate
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry.projection import ideal_pixels, unproject_pixels
from vsx_ros.kernels.slam.epipolar import search_rays
from vsx_ros.kernels.vision.patches import CENTRE
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.vision.corners import strongest
from vsx_ros.vision.patch_search import cast_rays, cut_patches, from_level, target_of, to_level
from vsx_ros.vision.pyramid import LEVELS

_SHARE = (0.40, 0.30, 0.20, 0.10)
_SPACING_PX = (10, 8, 6, 5)
_MAX_ERROR_PX = 2.0
NEAREST_M = 0.1


class Candidates(NamedTuple):
    """Corners without a depth: uv (C, 2) level-0 px, level (C,), rays (C, 2), basis (C, 4), patches (C, 24, 24)."""

    uv: FloatArray
    level: IntArray
    rays: FloatArray
    basis: FloatArray
    patches: NDArray[np.uint8]

    def where(self, mask: BoolArray) -> Candidates:
        """Those the mask keeps."""
        return Candidates._make(column[mask] for column in self)


class TargetMatches(NamedTuple):
    """Candidates (their numbers) found in a target keyframe: where, and the points (n, 3) in the world."""

    chosen: IntArray
    uv: FloatArray
    level: IntArray
    points_world: Points3


def observations_at(
    data: FrameData, T_world_cam: SE3, points: Points3, rows: IntArray, uv: FloatArray, level: IntArray
) -> Observations:
    """Observations of points (P, 3) world, those of ``rows``, at level-0 pixels of an image taken at a pose."""
    depth = np.maximum((points[rows] - T_world_cam.translation) @ T_world_cam.rotation[:, 2], NEAREST_M)
    ideal = ideal_pixels(data.camera, np.ascontiguousarray(uv), depth)
    return Observations(np.asarray(rows, np.int64), uv, ideal, np.asarray(level, np.int64))


def candidates_in(keyframe: KeyFrame, budget: int) -> Candidates:
    """The strongest corners of every level that no observation of the same or the next coarser level is near to."""
    parts = []
    for level in range(LEVELS):
        image = keyframe.data.pyramid.level(level)
        occupied = np.zeros(image.shape, np.bool_)
        radius = _SPACING_PX[level]
        observed = keyframe.observations
        near = observed.uv[(observed.level == level) | (observed.level == level + 1)]
        for x, y in np.rint(to_level(near, level)).astype(int):
            occupied[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1] = True
        corners = strongest(image, occupied, int(budget * _SHARE[level]), radius)
        rays = cast_rays(keyframe.data.camera, corners, level)
        parts.append(
            (
                from_level(corners.astype(float), level),
                np.full(len(corners), level, np.int64),
                rays.direction,
                rays.basis,
                cut_patches(keyframe.data.pyramid, corners, level),
            )
        )
    return Candidates(*(np.concatenate(column) for column in zip(*parts)))


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
    bounds = np.tile([1.0 / depth_range[1], 1.0 / depth_range[0]], (n, 1))
    found, uv, level = search_rays(
        camera, T_target_source.rotation, T_target_source.translation, candidates.rays, candidates.basis,
        candidates.patches, bounds, target_of(target.data.pyramid, target.data.corners),
    )  # fmt: skip
    index = np.flatnonzero(found)
    uv, level = uv[index], level[index]
    points, keep = checked_points(
        T_target_source,
        candidates.rays[index],
        unproject_pixels(camera, uv),
        (_MAX_ERROR_PX / camera[0] * 2.0 ** candidates.level[index], _MAX_ERROR_PX / camera[0] * 2.0**level),
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
    """Triangulated points (N, 3) in camera a, and which of them (N,) have parallax, depth and small errors [z = 1]."""
    points, parallax = triangulate(T_b_a, rays_a, rays_b)
    depth = points[:, 2]
    keep = (parallax >= min_parallax_rad) & (depth > depth_range[0]) & (depth < depth_range[1])
    keep &= reprojection_error(T_b_a, points, rays_b) < tolerance[1]
    keep &= reprojection_error(SE3.identity(), points, rays_a) < tolerance[0]
    return points, keep


def templates_of(candidates: Candidates, index: IntArray) -> NewTemplates:
    """How chosen candidates look."""
    return NewTemplates(candidates.basis[index], np.zeros((len(index), 2)), candidates.patches[index])


def templates_in(keyframe: KeyFrame, chosen: IntArray) -> tuple[IntArray, NewTemplates]:
    """How points look in a keyframe that observes them: (which of ``chosen``, indices into its observations, have a
    whole patch; their templates)."""
    observed = keyframe.observations
    kept, parts = [], []
    for level in range(LEVELS):
        index = chosen[observed.level[chosen] == level]
        at = to_level(observed.uv[index], level)
        whole = np.rint(at).astype(np.int32)
        height, width = keyframe.data.pyramid.level(level).shape
        inside = ((whole >= CENTRE) & (whole < np.array([width, height]) - CENTRE)).all(axis=1)
        index, at, whole = index[inside], at[inside], whole[inside]
        rays = cast_rays(keyframe.data.camera, whole, level)
        kept.append(index)
        parts.append((rays.basis, at - whole, cut_patches(keyframe.data.pyramid, whole, level)))
    return np.concatenate(kept), NewTemplates(*(np.concatenate(column) for column in zip(*parts)))
