"""The planes of one tile of the map: hypotheses, J-linkage, refinement."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, IntArray
from vsx_ros.config import PlanesConfig
from vsx_ros.dense.jlinkage import cluster
from vsx_ros.dense.plane_fitting import Attitude, Fit, fit_plane, on_plane
from vsx_ros.dense.plane_hypotheses import draw_hypotheses
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, plane_preferences

_PASSES = 2
_VOXEL_M = 0.10
_MIN_NEW = 0.5
_MIN_SPREAD_M = 0.03
_MAX_TILT_SIGMA_RAD = 0.12


def noise_of(config: PlanesConfig, unit: float) -> Noise:
    """How far a point may lie off its plane; unit: length [m or the map's] of what is 1 m in a building."""
    return Noise(config.floor_sigma_m * unit, config.inlier_sigmas, config.max_distance_m * unit)


def is_plane(fit: Fit, noise: Noise) -> bool:
    """Whether the points spread in two directions and tell the tilt; a row of points belongs to any plane."""
    tilt = np.sqrt(np.diag(fit.covariance)[:2])
    return bool(fit.spread.min() > _MIN_SPREAD_M / 0.01 * noise.floor and tilt.max() < _MAX_TILT_SIGMA_RAD)


def spread_out(points: ObservedPoints, count: int, voxel: float) -> IntArray:
    """Rows of at most ``count`` points: the best known of every voxel, then the second best, and so on."""
    if len(points.world) <= count:
        return np.arange(len(points.world))
    _, voxels = np.unique(np.floor(points.world / voxel).astype(np.int64), axis=0, return_inverse=True)
    order = np.lexsort((points.sigma, voxels.ravel()))
    number = voxels.ravel()[order]
    start = np.flatnonzero(np.r_[True, number[1:] != number[:-1]])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    return np.sort(order[np.lexsort((points.sigma[order], rank))[:count]])


def planes_of_tile(
    points: ObservedPoints, config: PlanesConfig, upright: bool, unit: float, rng: np.random.Generator
) -> list[tuple[Fit, IntArray]]:
    """Planes and their points' ids. The points: of one tile, the floor's taken out.

    The points that no plane explains are asked again: among fewer points, pairs from one small face are drawn more
    often.
    """
    planes = list[tuple[Fit, IntArray]]()
    for _ in range(_PASSES):
        if len(points.world) < config.min_points:
            break
        fits = _linked(points, config, upright, unit, rng)
        fresh, explained = _unexplained(points, fits, config.min_points, noise_of(config, unit))
        if not fresh:
            break
        planes += fresh
        points = points.at(np.flatnonzero(~explained))
    return planes


def _linked(
    points: ObservedPoints, config: PlanesConfig, upright: bool, unit: float, rng: np.random.Generator
) -> list[Fit]:
    """The planes of the clusters that J-linkage makes of some points."""
    noise = noise_of(config, unit)
    chosen = points.at(spread_out(points, config.max_points_per_tile, _VOXEL_M * unit))
    hypotheses, attitudes = draw_hypotheses(
        chosen, config.hypotheses, upright, config.partner_sigma_m * unit, config.min_separation_m * unit, rng
    )
    preferences = plane_preferences(chosen, hypotheses, noise)
    labels = cluster(preferences)
    sizes = np.bincount(labels[labels >= 0], minlength=1)
    fits = []
    for label in np.flatnonzero(sizes >= config.min_points // 2):
        members = np.flatnonzero(labels == label)
        shared = np.flatnonzero(_unpacked(np.bitwise_and.reduce(preferences[members]), len(hypotheses)))[0]
        fit = fit_plane(chosen, members, hypotheses[shared, :3], Attitude(attitudes[shared]), noise)
        if fit is not None and is_plane(fit, noise):
            fits.append(fit)
    return fits


def _unpacked(row: NDArray[np.uint64], count: int) -> BoolArray:
    bits: BoolArray = np.unpackbits(row.view(np.uint8), bitorder="little")[:count] > 0
    return bits


def _unexplained(
    points: ObservedPoints, fits: list[Fit], min_points: int, noise: Noise
) -> tuple[list[tuple[Fit, IntArray]], BoolArray]:
    """The fits of most points first, refined with all points of the tile; those left out whose points are mostly
    explained by earlier ones; and (N,) which points are explained."""
    every = np.arange(len(points.world))
    refined = [
        fit_plane(points, every[on_plane(points, every, fit, noise)], fit.normal, fit.attitude, noise) for fit in fits
    ]
    candidates = [(fit, on_plane(points, every, fit, noise)) for fit in refined if fit is not None]
    explained = np.zeros(len(points.world), np.bool_)
    kept = []
    for first, on_it in sorted(candidates, key=lambda candidate: -int(candidate[1].sum())):
        own = on_it & ~explained
        if own.sum() < max(min_points, _MIN_NEW * on_it.sum()):
            continue
        fit = fit_plane(points, every[own], first.normal, first.attitude, noise)
        if fit is not None and is_plane(fit, noise):
            explained |= on_it
            kept.append((fit, points.ids[own]))
    return kept, explained
