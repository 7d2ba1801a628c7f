"""An emulated world of triangles, as a Gazebo file describes it. Metres, world frame, floor at z = 0."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.sim.mesh_slab import slab_polygons
from vsx_ros.sim.gazebo.assemble import Parts
from vsx_ros.sim.gazebo.elements import Lamp
from vsx_ros.sim.world import Point, Start

SLICE_M = 0.02, 0.45  # above the floor: what a robot touches
FLOOR_STEP_M = 0.05  # between the floor's triangles and its height
_LEVEL_M = 0.02  # heights that count as one level
_LEAST_SHARE, _LEAST_GROUND = 0.3, 0.15  # of the largest level, and of the world's extent, that a floor has
_LEAST_HELD = 0.5  # of the most shapes on a level, that stand on the floor
_STEEP = 0.98  # z of a level triangle's normal, at least
_ROUND_M = 0.001  # of segments, to drop doubles
RICH, SIGHT_MOST_M, SIGHT_HIGH_M = 30.0, 3.0, 2.0  # deviation of a texture; size and height of a thing to look at
_INSIDE_HEIGHTS = 5  # of the slice, at which a closed solid is looked for
MAX_AREA_M2 = 40_000.0  # limits the memory: 16 million cells of 5 cm
AROUND_M = 0.5  # ground around the obstacles that belongs to the world


@dataclass(frozen=True, eq=False)
class MeshWorld:
    """file, folders: what it was read from, and where its models are looked for. floor_z_m: height of the floor in the
    file; everything here is lower by it. obstacle_bounds: x_min, y_min, x_max, y_max of what a robot can touch [m].
    hard: amounts of ``HARD_THINGS`` by name."""

    name: str
    file: Path
    folders: tuple[Path, ...]
    start: Start
    floor_z_m: float
    obstacle_bounds: tuple[float, float, float, float]
    parts: Parts
    lamps: list[Lamp]
    ambient: float
    sky: float
    hard: dict[str, float] = field(default_factory=dict)

    @property
    def start_pose(self) -> SE2:
        """T_world_base at the beginning."""
        return SE2(self.start.x, self.start.y, self.start.theta_rad)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max [m] of obstacles and start, which may be away from them on an open floor; of the
        obstacles alone if that is too large."""
        (x0, y0, x1, y1), (x, y) = self.obstacle_bounds, (self.start.x, self.start.y)
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        return (x0, y0, x1, y1) if (x1 - x0) * (y1 - y0) <= MAX_AREA_M2 else self.obstacle_bounds

    @property
    def sights(self) -> list[Point]:
        """Places of things up to 2 m high with a rich texture, good to look at."""
        return _sights(self)

    def starting_at(self, start: Start) -> "MeshWorld":
        """The same world with another start."""
        return replace(self, start=start)

    def plan(self, z_min: float, z_max: float) -> Iterator[tuple[Points2, bool]]:
        """Polygons (N, 2), and whether they are solid between the heights [m]; later ones cover earlier ones. First the
        floor. The floor itself is no obstacle: z_min is at least 2 cm."""
        for triangle in floor_triangles(self):
            yield triangle, False
        polygons, counts, _ = self.slab(z_min, z_max)
        for polygon, count in zip(polygons, counts):
            yield polygon[:count], True

    def slab(self, z_min: float, z_max: float) -> tuple[FloatArray, IntArray, IntArray]:
        """As ``slab_polygons``, of the solids between the heights."""
        return slab_polygons(self.parts.solids, max(z_min, SLICE_M[0]), z_max)

    def obstacle_segments(self, z_min: float, z_max: float) -> FloatArray:
        """(N, 4) borders of all solids between the heights: x0, y0, x1, y1 [m]."""
        return _segments(self, z_min, z_max)

    def owner_near(self, x: float, y: float) -> str:
        """The name of the model whose solids at a robot's height lie nearest to a place."""
        polygons, counts, owners = self.slab(*SLICE_M)
        points = np.where(np.arange(5)[None, :, None] < counts[:, None, None], polygons, np.inf)
        gaps = np.hypot(points[..., 0] - x, points[..., 1] - y).min(axis=1)
        return self.parts.names[int(self.parts.owners[owners[int(np.argmin(gaps))]])]

    def owner_around(self, x: float, y: float) -> str | None:
        """The name of the model with a closed solid around a place at a robot's height, or None. A solid's triangles
        are its surface: nothing is occupied inside."""
        for z in np.linspace(*SLICE_M, _INSIDE_HEIGHTS):
            turns = _turns_around(self.parts, np.array([x, y, z]))
            if len(turns) and turns.max() > 0.5:
                return self.parts.names[int(np.argmax(turns))]
        return None


def _turns_around(parts: Parts, point: FloatArray) -> FloatArray:
    """(K,) winding number of each shape around a point (3,): 1 inside a closed surface that looks outwards, 0 outside.
    Van Oosterom and Strackee 1983."""
    a, b, c = (parts.solids[:, i] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    edges = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return np.bincount(parts.owners, np.arctan2(volume, edges), len(parts.names)) / (2.0 * math.pi)


@lru_cache(maxsize=4)
def _sights(world: MeshWorld) -> list[Point]:
    seen = world.parts.seen
    rich = [row >= 0 and seen.textures.contrast[row] > RICH for row in seen.pictures]
    found = []
    for begin, end in zip(seen.starts[:-1], seen.starts[1:]):
        if begin < end and rich[seen.kinds[begin]]:
            points = seen.corners[begin:end].reshape(-1, 3)
            low, high = points.min(axis=0), points.max(axis=0)
            if (high - low).max() < SIGHT_MOST_M and low[2] < SIGHT_HIGH_M:
                found.append((float(low[0] + high[0]) / 2.0, float(low[1] + high[1]) / 2.0))
    return found


@lru_cache(maxsize=4)
def _segments(world: MeshWorld, z_min: float, z_max: float) -> FloatArray:
    return _borders(*world.slab(z_min, z_max)[:2])


def _borders(polygons: FloatArray, counts: IntArray) -> FloatArray:
    """(N, 4) sides of polygons (M, 5, 2) with counts (M,) corners, each once; of an upright wall, whose polygon is a
    line, only this line."""
    segments = []
    for n in np.unique(counts):
        some = polygons[counts == n, :n]
        span = np.ptp(some, axis=1)
        along = np.where((span[:, 0] >= span[:, 1])[:, None], some[..., 0], some[..., 1])
        rows = np.arange(len(some))
        lines = np.concatenate([some[rows, along.argmin(axis=1)], some[rows, along.argmax(axis=1)]], axis=1)
        following = np.roll(some, -1, axis=1)
        areas = 0.5 * np.abs((some[..., 0] * following[..., 1] - following[..., 0] * some[..., 1]).sum(axis=1))
        flat = areas < 1e-3 * np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
        segments += [lines[flat], np.concatenate([some, following], axis=2)[~flat].reshape(-1, 4)]
    if not segments:
        return np.zeros((0, 4))
    found = np.rint(np.concatenate(segments) / _ROUND_M)
    backwards = (found[:, 0] > found[:, 2]) | ((found[:, 0] == found[:, 2]) & (found[:, 1] > found[:, 3]))
    found[backwards] = found[backwards][:, [2, 3, 0, 1]]
    return np.unique(found, axis=0) * _ROUND_M


def _level_triangles(corners: FloatArray, least: float) -> tuple[FloatArray, FloatArray]:
    """The triangles (T, 3, 3) whose normal has at least this z, and their areas [m2]."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    upward = normals[:, 2] if least > 0.0 else np.abs(normals[:, 2])
    level = upward > abs(least) * np.maximum(lengths, 1e-12)
    return corners[level], 0.5 * lengths[level]


def floor_height(parts: Parts) -> float | None:
    """Height of the floor [m], or None: the lowest large level that looks up, has room for a robot above it and holds
    things; of the solids if they have one, else of what is seen; last, of faces that look down. If none holds
    anything, the lowest large level."""
    x0, y0, x1, y1 = ground_bounds(parts.solids, -math.inf)
    most = max((x1 - x0) * (y1 - y0), 1.0)
    everything = parts.solids, np.asarray(parts.seen.corners, float)
    bare = None
    for corners, least in ((corners, least) for least in (_STEEP, -_STEEP) for corners in everything):
        level, areas = _level_triangles(corners, least)
        heights = np.rint(level[..., 2].mean(axis=1) / _LEVEL_M).astype(np.int64)
        levels, which = np.unique(heights, return_inverse=True)
        sizes = np.minimum(np.bincount(which, np.minimum(areas, most), len(levels)), most)
        if not len(levels) or sizes.max() < _LEAST_GROUND * most:
            continue
        large = levels[sizes >= _LEAST_SHARE * sizes.max()]
        gaps = np.diff(large, append=large[-1] + 10**6) * _LEVEL_M
        chosen = [heights == height for height in large[gaps > SLICE_M[1]]]
        floors = [float(np.average(level[rows][..., 2].mean(axis=1), weights=areas[rows])) for rows in chosen]
        held = [_shapes_on(parts, floor) for floor in floors]
        if max(held) > 0:
            return floors[int(np.argmax(np.array(held) >= _LEAST_HELD * max(held)))]
        bare = floors[0] if bare is None else bare
    return bare


def _shapes_on(parts: Parts, floor_z_m: float) -> int:
    """How many shapes a robot on this floor can touch."""
    _, _, triangles = slab_polygons(parts.solids, floor_z_m + SLICE_M[0], floor_z_m + SLICE_M[1])
    return len(np.unique(parts.owners[triangles]))


def ground_bounds(solids: FloatArray, floor_z_m: float) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max of the solids that a robot on this floor can touch, or of all solids higher than a
    floor that is not known (-inf) [m]; with some ground around. Zeros if there are none."""
    points = solids.reshape(-1, 3)
    if math.isfinite(floor_z_m):
        polygons, counts, _ = slab_polygons(solids, floor_z_m + SLICE_M[0], floor_z_m + SLICE_M[1])
        points = polygons[np.arange(5)[None, :] < counts[:, None]]
    else:
        upright = np.ptp(solids[..., 2], axis=1) > SLICE_M[0]
        points = solids[upright].reshape(-1, 3)
    if not len(points):
        return 0.0, 0.0, 0.0, 0.0
    low, high = points[:, :2].min(axis=0) - AROUND_M, points[:, :2].max(axis=0) + AROUND_M
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


@lru_cache(maxsize=4)
def floor_triangles(world: MeshWorld) -> list[Points2]:
    """(3, 2) triangles of the floor, of solids and of what is seen, cut to the neighbourhood of the bounds [m]."""
    x0, y0, x1, y1 = world.bounds
    found = []
    for corners in (world.parts.solids, np.asarray(world.parts.seen.corners, float)):
        level, _ = _level_triangles(corners, -_STEEP)
        level = level[np.abs(level[..., 2]).max(axis=1) < FLOOR_STEP_M]
        outside = (level[..., 0].max(axis=1) < x0) | (level[..., 0].min(axis=1) > x1)
        outside |= (level[..., 1].max(axis=1) < y0) | (level[..., 1].min(axis=1) > y1)
        found += list(level[~outside][..., :2])
    return found
