"""Merges planes of overlapping tiles into planes of the map."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.dense.plane_tiles import is_plane
from vsx_ros.dense.planes import Fit, fit_plane, on_plane
from vsx_ros.kernels.dense.plane_choice import beside, best_planes
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, deviations

_MAX_ANGLE_COS = math.cos(math.radians(12.0))  # pieces of one wall in two tiles, with few points each, differ by less
_SAME_SHARE, _MIN_OWN = 0.8, 0.5  # of a piece's points on the common plane; of the points on a plane, its own
_GAP_M, _MARGIN_M = 1.5, 0.3  # more than a door's width separates two planes; a plane may own points around its box
_CELL_M, _COMPANY, _COMPACT_SHARE = 0.25, 4, 0.7  # least points in a cell and its 8 neighbours; share of such points
_MANY_POINTS, _DENSE_PER_M2 = 40, 20.0  # always enough, or this many per square metre
_AROUND_M, _ALONE_SHARE = 0.5, 0.7  # in front and behind; share of the points there that are the plane's own
_GROUP = np.dtype("i8, 3f8, 3f8, (2, 3)f8, (2, 2)f8")
_GROUP.names = "attitude", "normal", "middle", "axes", "box"
"""Table of planes, to exclude at once those that a piece cannot join: a building has hundreds of planes."""


class Found(NamedTuple):
    """A plane and the rows of its points."""

    fit: Fit
    rows: IntArray


def merged(pieces: list[Found], points: ObservedPoints, min_points: int, noise: Noise, unit: float) -> list[Found]:
    """The planes of all tiles, each once, those with most points first. Each point is on the plane it fits best."""
    groups: list[Found] = []
    table = np.zeros(len(pieces), _GROUP)
    for piece in sorted(pieces, key=lambda piece: -len(piece.rows)):
        for k in _near(table[: len(groups)], piece, points, noise, unit):
            joined = _joined(groups[k], piece, points, noise, unit)
            if joined is not None:
                groups[k] = joined
                break
        else:
            k = len(groups)
            groups.append(piece)
        fit = groups[k].fit
        table[k] = fit.attitude, fit.normal, fit.middle, in_plane_axes(fit.normal), _box(groups[k], points, 0.0)
    groups = _distinct(groups, points, min_points, noise, unit)
    groups = _shared_out(groups, points, min_points, noise, unit)
    return _shared_out(groups, points, min_points, noise, unit)


def _near(table: NDArray[np.void], piece: Found, points: ObservedPoints, noise: Noise, unit: float) -> IntArray:
    """Indices, ascending, of the groups in a table that lie in the plane of a piece and may touch it."""
    low, high = points.world[piece.rows].min(axis=0), points.world[piece.rows].max(axis=0)
    alike = table["normal"] @ piece.fit.normal >= _MAX_ANGLE_COS
    k = np.flatnonzero(alike & (table["attitude"] == piece.fit.attitude))
    near = table[k]
    off = np.abs(((piece.fit.middle - near["middle"]) * near["normal"]).sum(axis=1))
    centre, half = near["axes"] @ (0.5 * (low + high)), np.abs(near["axes"]) @ (0.5 * (high - low))
    gap = np.maximum(near["box"][:, 0] - (centre + half), (centre - half) - near["box"][:, 1])
    return np.asarray(k[(off <= 4.0 * noise.limit) & (gap.max(axis=1, initial=-1.0) <= _GAP_M * unit)])


def _joined(a: Found, b: Found, points: ObservedPoints, noise: Noise, unit: float) -> Found | None:
    """Two groups joined to one plane; None if they lie apart or no plane fits both."""
    axes = in_plane_axes(a.fit.normal)
    one, other = points.world[a.rows] @ axes.T, points.world[b.rows] @ axes.T
    gap = np.maximum(one.min(axis=0) - other.max(axis=0), other.min(axis=0) - one.max(axis=0))
    if gap.max() > _GAP_M * unit:
        return None
    rows = np.union1d(a.rows, b.rows)
    fit = fit_plane(points, rows, a.fit.normal, a.fit.attitude, noise)
    if fit is None:
        return None
    for part in (a, b):
        if on_plane(points, part.rows, fit, noise).mean() < _SAME_SHARE:
            return None
    return Found(fit, rows)


def _distinct(groups: list[Found], points: ObservedPoints, min_points: int, noise: Noise, unit: float) -> list[Found]:
    """The groups, those with most points first, without those whose points mostly lie on earlier ones. Within the noise
    these are the same surface; each would take points from the other until neither is left."""
    explained, kept = np.zeros(len(points.world), np.bool_), list[Found]()
    for group in sorted(groups, key=lambda group: -len(group.rows)):
        if np.count_nonzero(~explained[group.rows]) < max(min_points, _MIN_OWN * len(group.rows)):
            continue
        kept.append(group)
        near = beside(points.world, in_plane_axes(group.fit.normal), *_box(group, points, _MARGIN_M * unit))
        explained[near[on_plane(points, near, group.fit, noise)]] = True
    return kept


def _shared_out(groups: list[Found], points: ObservedPoints, min_points: int, noise: Noise, unit: float) -> list[Found]:
    """Assign every point to the plane it fits best. Refit the planes, split them at gaps, and drop those of which
    others explain most points."""
    out = []
    for group, own in zip(groups, _owners(groups, points, min_points, noise, unit)):
        for part in _pieces(points.world[own] @ in_plane_axes(group.fit.normal).T, _GAP_M * unit):
            found = _standing(group.fit, own[part], points, min_points, noise, unit)
            if found is not None:
                out.append(found)
    return sorted(out, key=lambda found: -len(found.rows))


def _owners(groups: list[Found], points: ObservedPoints, min_points: int, noise: Noise, unit: float) -> list[IntArray]:
    """The rows that fit each group best. Groups with too few points give them to the others, the smallest group first:
    wrong planes that cross a small face would take too many of its points."""
    if not groups:
        return []
    axes = np.array([in_plane_axes(group.fit.normal) for group in groups])
    boxes = np.array([_box(group, points, _MARGIN_M * unit) for group in groups])
    planes = np.array([group.fit.plane for group in groups])
    order = np.argsort([len(group.rows) for group in groups], kind="stable")
    owner = best_planes(points, planes, axes, boxes, min_points, order, noise)
    return [np.flatnonzero(owner == k) for k in range(len(groups))]


def _standing(
    guess: Fit, rows: IntArray, points: ObservedPoints, min_points: int, noise: Noise, unit: float
) -> Found | None:
    """The plane near a guess through the points (rows), with or without isolated points; None if neither is a plane.
    If few points are isolated, it tries without them first: they would make the plane too large."""
    if len(rows) < min_points:
        return None
    core = rows[_in_company(points.world[rows] @ in_plane_axes(guess.normal).T, unit)]
    few = len(core) >= _COMPACT_SHARE * len(rows)
    for some in (core, rows) if few else (rows, core):
        fit = fit_plane(points, some, guess.normal, guess.attitude, noise) if len(some) >= min_points else None
        if fit is not None and _stands(Found(fit, some), points, noise, unit):
            return Found(fit, some)
    return None


def _in_company(coordinates: FloatArray, unit: float) -> BoolArray:
    """(N,) which points have enough others around them, in their own cell and the eight around it."""
    cells = np.floor(coordinates / (_CELL_M * unit)).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    counts = np.zeros(cells.max(axis=0) + 2)
    np.add.at(counts, (cells[:, 0], cells[:, 1]), 1.0)
    around = sum(counts[cells[:, 0] + i, cells[:, 1] + j] for i in (-1, 0, 1) for j in (-1, 0, 1))
    return np.asarray(np.asarray(around) >= _COMPANY)


def _stands(found: Found, points: ObservedPoints, noise: Noise, unit: float) -> bool:
    """Whether the plane's own points are enough. They must spread in two directions and be at least half of the points
    on the plane there. They must be many, dense, or nearly alone in front and behind: a few points among others may lie
    on a plane by chance."""
    if not is_plane(found.fit, noise):
        return False
    own, (low, high) = len(found.rows), _box(found, points, 0.0)
    around = beside(points.world, in_plane_axes(found.fit.normal), low, high)
    size = (high - low) / unit
    if own < min(_MANY_POINTS, _DENSE_PER_M2 * size[0] * size[1]):
        far = deviations(points, around, found.fit.plane, noise._replace(limit=_AROUND_M * unit))
        if own < _ALONE_SHARE * np.isfinite(far).sum():
            return False
    return bool(own >= _MIN_OWN * on_plane(points, around, found.fit, noise).sum())


def _box(found: Found, points: ObservedPoints, margin: float) -> FloatArray:
    """(2, 2) least and greatest coordinates of the plane's own points along its axes, extended by a margin [m]."""
    own = points.world[found.rows] @ in_plane_axes(found.fit.normal).T
    return np.array([own.min(axis=0) - margin, own.max(axis=0) + margin])


def _pieces(coordinates: FloatArray, gap: float) -> list[IntArray]:
    """Rows of points between gaps along the first axis, then along the second."""
    pieces: list[IntArray] = [np.arange(len(coordinates))]
    for axis in range(2):
        finer = list[IntArray]()
        for rows in pieces:
            order = rows[np.argsort(coordinates[rows, axis], kind="stable")]
            cuts = np.flatnonzero(np.diff(coordinates[order, axis]) > gap) + 1
            finer += [np.sort(part) for part in np.split(order, cuts)]
        pieces = finer
    return pieces
