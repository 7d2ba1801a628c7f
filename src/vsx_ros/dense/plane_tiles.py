"""The planes of one tile of the map: hypotheses through a few near points drawn at random, clusters of points by
J-linkage (Toldo and Fusiello, ECCV 2008), then refinement."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.planes import Attitude, Fit, fit_plane, on_plane
from vsx_ros.errors import InputError
from vsx_ros.kernels.dense.jlinkage import WORD, agglomerate
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, first_accepted, plane_preferences

_MAX_WORDS = 65535 // WORD  # the kernel counts bits in 16-bit numbers
_TRIES = 24  # random candidates for a point's partner in a hypothesis; near ones are accepted more often
_LEVEL_SHARE = 0.1  # share of level hypotheses: tables and boxes have few points, walls many
_MIN_FACING, _MIN_SINE = 0.05, 0.25  # cosine and sine: an edge-on view, or points nearly in line, give no plane
_PASSES, _MIN_NEW = 2, 0.5  # the second uses the points left by the first; least share of new points of a plane
_VOXEL_M = 0.10  # one point per voxel is enough: posters have hundreds
_MIN_SPREAD_M, _MAX_TILT_SIGMA_RAD = 0.03, 0.12  # at a floor noise of 1 cm; else the tilt is too uncertain


def cluster(preferences: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(N,) labels from 0, -1 for points that prefer no model.

    preferences: (N, W), bit h of a row is set if the point prefers model h. Among equally near clusters those with
    smaller rows merge first, so the order of the points does not matter. Labels are in the order of their first points.
    Raises InputError for rows of more than 65472 models or of another type."""
    preferences = np.asarray(preferences)
    if preferences.ndim != 2 or preferences.dtype != np.uint64 or preferences.shape[1] > _MAX_WORDS:
        raise InputError(
            f"preferences are {preferences.dtype} of shape {preferences.shape}; J-linkage takes (N, W) uint64 with "
            f"W <= {_MAX_WORDS}"
        )
    labels = np.full(len(preferences), -1, np.int64)
    willing = np.flatnonzero(preferences.any(axis=1))
    if not len(willing):
        return labels
    # Equal rows are at distance 0 and merge first; the remaining rows are sorted.
    rows, inverse = np.unique(preferences[willing], axis=0, return_inverse=True)
    into = agglomerate(rows)
    while not np.array_equal(into, into[into]):
        into = into[into]
    _, first, found = np.unique(into[inverse.ravel()], return_index=True, return_inverse=True)
    labels[willing] = np.argsort(np.argsort(first))[found.ravel()]
    return labels


def _partners(
    points: ObservedPoints, first: IntArray, across: int, sigma_m: float, apart_m: float, rng: np.random.Generator
) -> IntArray:
    """(M,) for each point a partner, accepted at distance d with probability exp(-d^2 / sigma^2) and only if farther
    away than the noise; -1 if none was accepted. across: how many coordinates the least distance counts."""
    candidates = rng.integers(len(points.world), size=(len(first), _TRIES))
    return first_accepted(points, first, candidates, rng.random(candidates.shape), across, sigma_m, apart_m)


def _facing(points: ObservedPoints, normals: FloatArray, through: list[IntArray]) -> FloatArray:
    """(M, 4) planes through their first points, facing its observers; NaN if another point's observers do not."""
    side = (points.views[through[0]] * normals).sum(axis=1)
    normals = normals * np.where(side < 0.0, -1.0, 1.0)[:, None]
    for rows in through:
        normals[(points.views[rows] * normals).sum(axis=1) <= _MIN_FACING] = np.nan
    offsets = (points.world[through[0]] * normals).sum(axis=1)
    return np.column_stack([normals, offsets])


def draw_hypotheses(
    points: ObservedPoints, count: int, up: FloatArray, tied: bool, sigma_m: float, apart_m: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """(M, 4) unit normals and offsets, and (M,) their Attitude; at most ``count`` of them.

    up: (3,), exact if tied. Level planes go through one point, vertical ones through two. If not tied, half of all
    planes go through three points, and every plane may tilt afterwards."""
    first, number = rng.integers(len(points.world), size=count), np.arange(count)
    level = number < _LEVEL_SHARE * count
    second = _partners(points, first, 2 if tied else 3, sigma_m, apart_m, rng)
    across = np.cross(points.world[second] - points.world[first], up)
    length = np.linalg.norm(across, axis=1)
    normals = across / np.where((second >= 0) & (length > 0.0), length, np.nan)[:, None]
    normals[level] = up
    through = [first, np.where(level, first, second)]
    if not tied:
        free = number >= 0.5 * count
        third = _partners(points, first, 3, sigma_m, apart_m, rng)
        normals[free] = _through_three(points, first[free], second[free], third[free])
        through.append(np.where(free, third, first))
    planes = _facing(points, normals, through)
    kept = np.isfinite(planes).all(axis=1)
    attitudes = np.where(level, int(Attitude.LEVEL), int(Attitude.UPRIGHT)) if tied else np.zeros(count, np.int64)
    return planes[kept], attitudes[kept]


def _through_three(points: ObservedPoints, first: IntArray, second: IntArray, third: IntArray) -> FloatArray:
    """(M, 3) unit normals of the planes through three points; NaN where these are nearly in line, or not drawn."""
    a, b = points.world[second] - points.world[first], points.world[third] - points.world[first]
    normals = np.cross(a, b)
    length = np.linalg.norm(normals, axis=1)
    wide = length > _MIN_SINE * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.asarray(normals / np.where(wide & (second >= 0) & (third >= 0), length, np.nan)[:, None])


def is_plane(fit: Fit, noise: Noise) -> bool:
    """Whether the points spread in two directions and determine the tilt; a line of points fits many planes."""
    tilt = np.sqrt(np.diag(fit.covariance)[:2])
    return bool(fit.spread.min() > _MIN_SPREAD_M / 0.01 * noise.floor and tilt.max() < _MAX_TILT_SIGMA_RAD)


def spread_out(points: ObservedPoints, count: int, voxel: float) -> IntArray:
    """Rows of at most ``count`` points: the most certain one of every voxel, then the second, and so on."""
    if len(points.world) <= count:
        return np.arange(len(points.world))
    _, voxels = np.unique(np.floor(points.world / voxel).astype(np.int64), axis=0, return_inverse=True)
    order = np.lexsort((points.sigma, voxels.ravel()))
    number = voxels.ravel()[order]
    start = np.flatnonzero(np.r_[True, number[1:] != number[:-1]])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    return np.sort(order[np.lexsort((points.sigma[order], rank))[:count]])


def planes_of_tile(
    points: ObservedPoints, config: PlanesConfig, up: FloatArray, tied: bool, noise: Noise, unit: float,
    rng: np.random.Generator,
) -> list[tuple[Fit, IntArray]]:  # fmt: skip
    """Planes and their points' ids. points: those of one tile, without the floor's. up, tied: see
    ``draw_hypotheses``. unit: length of a metre in the map.

    A second pass uses the points that no plane explains: among fewer points, pairs from one small face are drawn more
    often."""
    planes = list[tuple[Fit, IntArray]]()
    for _ in range(_PASSES):
        if len(points.world) < config.min_points:
            break
        fits = _linked(points, config, up, tied, noise, unit, rng)
        fresh, explained = _unexplained(points, fits, config.min_points, noise)
        if not fresh:
            break
        planes += fresh
        points = points.at(np.flatnonzero(~explained))
    return planes


def _linked(
    points: ObservedPoints, config: PlanesConfig, up: FloatArray, tied: bool, noise: Noise, unit: float,
    rng: np.random.Generator,
) -> list[Fit]:  # fmt: skip
    """The planes of the clusters that J-linkage finds."""
    chosen = points.at(spread_out(points, config.max_points_per_tile, _VOXEL_M * unit))
    reach, apart = config.partner_sigma_m * unit, config.min_separation_m * unit
    hypotheses, attitudes = draw_hypotheses(chosen, config.hypotheses, up, tied, reach, apart, rng)
    preferences = plane_preferences(chosen, hypotheses, noise)
    labels = cluster(preferences)
    sizes = np.bincount(labels[labels >= 0], minlength=1)
    fits = []
    for label in np.flatnonzero(sizes >= config.min_points // 2):
        members = np.flatnonzero(labels == label)
        common = np.bitwise_and.reduce(preferences[members])
        shared = int(np.unpackbits(common.view(np.uint8), bitorder="little").argmax())
        fit = fit_plane(chosen, members, hypotheses[shared, :3], Attitude(attitudes[shared]), noise)
        if fit is not None and is_plane(fit, noise):
            fits.append(fit)
    return fits


def _unexplained(
    points: ObservedPoints, fits: list[Fit], min_points: int, noise: Noise
) -> tuple[list[tuple[Fit, IntArray]], BoolArray]:
    """The fits, those with most points first, refined with all points of the tile, without those whose points earlier
    ones mostly explain; and (N,) which points are explained."""
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
