"""The planes of the map, updated while it grows (paper 5.1: dominant planes of the sparse map by J-linkage)."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.levelling import held_up
from vsx_ros.dense.plane_merging import Found, merged
from vsx_ros.dense.plane_noise import common_sigma
from vsx_ros.dense.plane_tiles import planes_of_tile
from vsx_ros.dense.planes import Attitude, Fit, Plane, PlaneKind, kind_of, on_plane
from vsx_ros.geometry.se3 import stacked
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, point_information
from vsx_ros.slam.snapshot import MapSnapshot

_MOVED_M = 0.01  # points that moved less count as unchanged
_CHANGED = 0.05  # share of a tile's points; if fewer are new or moved, its planes stay
_TYPICAL_RANGE_M = 2.0  # in rooms; a map that is not metric is scaled so that its median range is this
_NOISE_ROUNDS, _LIMIT_SIGMAS = 3, 4.0  # of estimating noise and finding planes with it; larger deviations are no noise
_FLOOR_GATE, _FLOOR_LIMIT_M = 3.0, 0.05  # standard deviations, but below the height where obstacles begin (6 cm)
_FLOOR_ID, _FLOOR_NORMAL = 0, np.array([0.0, 0.0, 1.0])  # the floor is plane number 0, z = 0 in the world
_FLOOR_COVARIANCE = np.diag([0.01, 0.01, 0.01]) ** 2  # tilts [rad2], offset [m2]
_EXTENT_SHARE = 0.005  # share of points left out at each end: outliers would stretch the plane

Key = tuple[int, ...]


class _Tile(NamedTuple):
    """The points of a tile, and the planes found in it with their points' ids."""

    ids: IntArray
    world: Points3
    planes: list[tuple[Fit, IntArray]]


class PlaneFinder:
    """Call ``update`` with each snapshot of one growing map. It recomputes only tiles whose points moved or changed.

    With a floor (a map made with odometry) z is up, z = 0 is the floor, lengths are metres, and planes are vertical or
    level. Without, planes have any direction, and the typical distance of the points gives the scale.
    common_sigma_m: noise that points have besides their own, estimated from the planes of the last update."""

    def __init__(self, focal_px: float, config: PlanesConfig, has_floor: bool, seed: int = 0) -> None:
        self._focal_px = focal_px
        self._config = config
        self._has_floor = has_floor
        self._seed = seed
        self._unit: float | None = 1.0 if has_floor else None
        self.common_sigma_m = config.floor_sigma_m
        self._tiles: dict[Key, _Tile] = {}
        self._ids: IntArray = np.zeros(0, np.int64)
        self._owner: IntArray = np.zeros(0, np.int64)
        self._next_id = _FLOOR_ID + 1

    @property
    def unit(self) -> float:
        """Length of a metre in the map: 1 if it has a floor, else estimated from the first points."""
        return self._unit if self._unit is not None else 1.0

    def update(self, snapshot: MapSnapshot) -> tuple[Plane, ...]:
        """The planes of the snapshot: the floor first, then those with most points. A plane keeps its id while most of
        its points remain."""
        points = observed_points(snapshot, self._focal_px, self._config.noise_px)
        if not len(points.world):
            return ()
        if self._unit is None:
            self._unit = float(np.median(points.range)) / _TYPICAL_RANGE_M
        up = _FLOOR_NORMAL if self._has_floor else held_up(snapshot.T_world_cams)
        for _ in range(_NOISE_ROUNDS):
            noise, used = self._noise(), self.common_sigma_m
            floor = self._on_floor(points)
            usable = np.flatnonzero(~floor & (points.sigma < self._config.max_sigma_m * self._unit))
            candidates = points.at(usable)
            self._redo(candidates, up, noise)
            tiled = (plane for key in sorted(self._tiles) for plane in self._tiles[key].planes)
            pieces = (Found(fit, _rows_of(ids, candidates.ids)) for fit, ids in tiled)
            still = [piece for piece in pieces if len(piece.rows)]  # a tile stays when few of its points were removed
            found = merged(still, candidates, self._config.min_points, noise, self._unit)
            self.common_sigma_m = common_sigma(found, candidates, used, self._config, self._unit)
            if self.common_sigma_m == used:
                break
            self._tiles = {}
        planes = list[Plane]()
        if floor.sum() >= self._config.min_points:
            on_floor = np.flatnonzero(floor)
            planes += [_plane(_FLOOR_ID, _FLOOR_NORMAL, 0.0, _FLOOR_COVARIANCE, PlaneKind.FLOOR, points, on_floor)]
        for number, (fit, rows) in zip(self._numbers(found, candidates), found):
            kind = kind_of(fit.normal, fit.offset) if fit.attitude is not Attitude.FREE else PlaneKind.OTHER
            plane = _plane(number, fit.normal, fit.offset, fit.covariance, kind, points, usable[rows])
            planes.append(plane._replace(covariance=fit.covariance_at(plane.middle)))
        return tuple(planes)

    def _on_floor(self, points: ObservedPoints) -> BoolArray:
        if not self._has_floor:
            return np.zeros(len(points.world), np.bool_)
        z = points.world[:, 2]
        gate = _FLOOR_GATE * np.sqrt(points.covariances[:, 2, 2] + self.common_sigma_m**2)
        return np.asarray(np.abs(z) < np.minimum(gate, _FLOOR_LIMIT_M))

    def _noise(self) -> Noise:
        """How far a point may lie off its plane."""
        sigma, config = self.common_sigma_m * self.unit, self._config
        return Noise(sigma, config.inlier_sigmas, max(config.max_distance_m * self.unit, _LIMIT_SIGMAS * sigma))

    def _redo(self, points: ObservedPoints, up: FloatArray, noise: Noise) -> None:
        """Find the planes of the half-overlapping tiles whose points have changed."""
        fresh: dict[Key, _Tile] = {}
        for key, rows in _tiled(points.world[:, : 2 if self._has_floor else 3], 0.5 * self._config.tile_m * self.unit):
            old = self._tiles.get(key)
            if old is None or _changed(old, points, rows, noise, self._config.min_points, _MOVED_M * self.unit):
                inside = points.at(rows)
                rng = np.random.default_rng([self._seed, *(2 * abs(k) + (k < 0) for k in key)])
                planes = planes_of_tile(inside, self._config, up, self._has_floor, noise, self.unit, rng)
                old = _Tile(inside.ids, inside.world, planes)
            fresh[key] = old
        self._tiles = fresh

    def _numbers(self, found: list[Found], points: ObservedPoints) -> list[int]:
        """An id for each plane, each id once. A plane takes the id of an earlier one if they share at least half of
        the points of the smaller one."""
        owner = np.zeros(len(points.ids), np.int64)
        _, now, before = np.intersect1d(points.ids, self._ids, assume_unique=True, return_indices=True)
        owner[now] = self._owner[before]
        size = np.bincount(self._owner, minlength=self._next_id)
        numbers = list[int]()
        for plane in found:
            shared = np.bincount(owner[plane.rows], minlength=len(size))
            shared[[_FLOOR_ID, *numbers]] = 0
            number = int(shared.argmax())
            if 2 * shared[number] < min(len(plane.rows), size[number]) or number == _FLOOR_ID:
                number = self._next_id
                self._next_id += 1
                size = np.append(size, 0)
            numbers.append(number)
        self._ids, self._owner = points.ids, np.zeros(len(points.ids), np.int64)
        for number, plane in zip(numbers, found):
            self._owner[plane.rows] = number
        return numbers


def _plane(
    number: int, normal: FloatArray, offset: float, covariance: FloatArray, kind: PlaneKind, points: ObservedPoints,
    rows: IntArray,
) -> Plane:  # fmt: skip
    axes = in_plane_axes(normal)
    ends = np.quantile(points.world[rows] @ axes.T, [_EXTENT_SHARE, 1.0 - _EXTENT_SHARE], axis=0)
    return Plane(
        id=number,
        normal=normal,
        offset=offset,
        covariance=covariance,
        kind=kind,
        axes=axes,
        extent=ends.T.ravel(),
        points=rows,
    )


def observed_points(snapshot: MapSnapshot, focal_px: float, noise_px: float) -> ObservedPoints:
    """All points of the snapshot, in its row order. noise_px: standard deviation of an observation at level 0."""
    world, seen = np.ascontiguousarray(snapshot.points_world), snapshot.rays
    _, centres = stacked(seen.T_world_cams)
    noise = noise_px / focal_px * np.exp2(seen.level, dtype=np.float64)
    information, rays, distances = point_information(world, centres, seen.keyframe, seen.point, noise)
    # Observations along one ray do not determine the depth; its standard deviation is then 10 m.
    covariances = np.asarray(np.linalg.inv(information + 1e-2 * np.eye(3)), np.float64)
    views = rays / np.maximum(np.linalg.norm(rays, axis=1), 1e-9)[:, None]
    sigma = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
    ranges = distances[:, 1] / np.maximum(distances[:, 0], 1.0)
    return ObservedPoints(
        ids=snapshot.point_ids, world=world, covariances=covariances, views=views, sigma=sigma, range=ranges
    )


def _rows_of(ids: IntArray, among: IntArray) -> IntArray:
    """Rows in ``among`` (ascending) of those ids that it still holds."""
    rows = np.searchsorted(among, ids)
    inside = rows < len(among)
    return np.asarray(rows[inside][among[rows[inside]] == ids[inside]])


def _tiled(points: FloatArray, stride: float) -> Iterator[tuple[Key, IntArray]]:
    """The tiles of (N, 2 or 3) points in ascending order, each with the ascending rows of its points. Tiles are two
    strides wide; each point is in every tile that covers it."""
    steps = np.floor(points / stride).astype(np.int64)
    shifts = np.indices((2,) * points.shape[1]).reshape(points.shape[1], -1).T
    every = np.concatenate([steps - shift for shift in shifts])
    low = every.min(axis=0, initial=0)
    number = np.ravel_multi_index(tuple((every - low).T), tuple(every.max(axis=0, initial=0) - low + 1))
    order = np.argsort(number, kind="stable")
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    for key, rows in zip(every[order[first]].tolist(), np.split(order % max(len(points), 1), first[1:])):
        yield tuple(key), np.sort(rows)


def _changed(old: _Tile, points: ObservedPoints, rows: IntArray, noise: Noise, min_points: int, moved: float) -> bool:
    """Whether more than a few of the tile's points (rows) are new, removed or moved by more than ``moved``, or enough
    new or moved ones for another plane lie on none of the tile's planes."""
    ids, world = points.ids[rows], points.world[rows]
    place = np.minimum(np.searchsorted(old.ids, ids), len(old.ids) - 1)
    known = old.ids[place] == ids
    known[known] = np.abs(old.world[place[known]] - world[known]).max(axis=1, initial=0.0) <= moved
    most = max(len(old.ids), len(ids))
    if most - np.count_nonzero(known) > _CHANGED * most:
        return True
    astray = rows[~known]
    for fit, _ in old.planes:
        astray = astray[~on_plane(points, astray, fit, noise)]
    return len(astray) >= min_points
