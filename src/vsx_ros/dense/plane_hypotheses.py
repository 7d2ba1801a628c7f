"""Planes through a few near points, drawn at random: what J-linkage lets the points choose from."""

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.dense.plane_fitting import Attitude
from vsx_ros.kernels.dense.planes import ObservedPoints, first_accepted

_TRIES = 24
_LEVEL_SHARE = 0.1
_MIN_FACING = 0.05
_MIN_SINE = 0.25


def _partners(
    points: ObservedPoints, first: IntArray, across: int, sigma_m: float, apart_m: float, rng: np.random.Generator
) -> IntArray:
    """(M,) for each point another one at a distance d with probability exp(-d^2 / sigma^2), farther away than its
    noise; -1 where none was drawn. across: how many coordinates the least distance counts."""
    candidates = rng.integers(len(points.world), size=(len(first), _TRIES))
    return first_accepted(points, first, candidates, rng.random(candidates.shape), across, sigma_m, apart_m)


def _facing(points: ObservedPoints, normals: FloatArray, through: list[IntArray]) -> FloatArray:
    """(M, 4) planes through their first points, turned to those who saw it; NaN where others saw them from behind."""
    side = (points.views[through[0]] * normals).sum(axis=1)
    normals = normals * np.where(side < 0.0, -1.0, 1.0)[:, None]
    for rows in through:
        normals[(points.views[rows] * normals).sum(axis=1) <= _MIN_FACING] = np.nan
    offsets = (points.world[through[0]] * normals).sum(axis=1)
    return np.column_stack([normals, offsets])


def draw_hypotheses(
    points: ObservedPoints, count: int, upright: bool, sigma_m: float, apart_m: float, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """(M, 4) unit normals and offsets, and (M,) their Attitude; at most ``count`` of them.

    upright: z is up and surfaces are vertical, through two points, or level, through one; else planes go through three.
    """
    first = rng.integers(len(points.world), size=count)
    if not upright:
        second, third = (_partners(points, first, 3, sigma_m, apart_m, rng) for _ in range(2))
        a, b = points.world[second] - points.world[first], points.world[third] - points.world[first]
        normals = np.cross(a, b)
        length = np.linalg.norm(normals, axis=1)
        wide = length > _MIN_SINE * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        drawn = wide & (second >= 0) & (third >= 0)
        normals = normals / np.where(drawn, length, np.nan)[:, None]
        planes = _facing(points, normals, [first, second, third])
        attitudes = np.full(count, int(Attitude.FREE))
    else:
        level = np.arange(count) < _LEVEL_SHARE * count
        second = _partners(points, first, 2, sigma_m, apart_m, rng)
        way = points.world[second] - points.world[first]
        length = np.linalg.norm(way[:, :2], axis=1)
        normals = (
            np.column_stack([way[:, 1], -way[:, 0], np.zeros(count)]) / np.where(second >= 0, length, np.nan)[:, None]
        )
        normals[level] = [0.0, 0.0, 1.0]
        planes = _facing(points, normals, [first, np.where(level, first, second)])
        attitudes = np.where(level, int(Attitude.LEVEL), int(Attitude.UPRIGHT))
    kept = np.isfinite(planes).all(axis=1)
    return planes[kept], attitudes[kept]
