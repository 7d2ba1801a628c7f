"""Points and planes: the uncertainty of points, and the planes that they prefer."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Int32Array, IntArray, Points3
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.jlinkage import WORD

_MIN_FACING = 0.05


class ObservedPoints(NamedTuple):
    """ids (N,): point_ids of the snapshot. world (N, 3). covariances (N, 3, 3) [m2] of the positions, given the
    keyframes. views (N, 3): mean unit direction to the observers. sigma (N,): standard deviation [m], all directions
    together. range (N,): mean distance of the observers [m]."""

    ids: IntArray
    world: Points3
    covariances: FloatArray
    views: FloatArray
    sigma: FloatArray
    range: FloatArray

    def at(self, rows: IntArray) -> ObservedPoints:
        """The points in these rows."""
        return ObservedPoints._make(column[rows] for column in self)


class Noise(NamedTuple):
    """How far a point may be from its plane. floor [m]: noise common to neighbours, besides its own; gate: largest
    number of standard deviations; limit [m]: largest distance."""

    floor: float
    gate: float
    limit: float


@kernel
def variance_along(c: FloatArray, a: float, b: float, e: float) -> float:
    """Variance of a point with covariance c (3, 3) along the unit vector (a, b, e)."""
    variance: float = (
        a * a * c[0, 0] + b * b * c[1, 1] + e * e * c[2, 2]
        + 2.0 * (a * b * c[0, 1] + a * e * c[0, 2] + b * e * c[1, 2])
    )  # fmt: skip
    return variance


@kernel
def point_information(
    points: FloatArray, centres: FloatArray, obs_keyframe: Int32Array, obs_point: Int32Array, obs_noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, 3, 3) information [1/m2], (N, 3) sums of unit rays to the observers and (N, 2) counts and sums of distances.

    An observation from distance r along the unit ray d adds (I - d d^T) / (r s)^2, where s is its noise [rad],
    obs_noise (O,). It measures only across the ray, so that depth comes from parallax alone."""
    n = points.shape[0]
    information, rays, distances = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 2))
    d = np.empty(3)
    for o in range(obs_point.shape[0]):
        i, k = obs_point[o], obs_keyframe[o]
        d[0], d[1], d[2] = (centres[k, 0] - points[i, 0], centres[k, 1] - points[i, 1], centres[k, 2] - points[i, 2])
        r = max(math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), 1e-9)
        weight = 1.0 / (r * obs_noise[o]) ** 2
        for a in range(3):
            d[a] /= r
            rays[i, a] += d[a]
            information[i, a, a] += weight
        for a in range(3):
            for b in range(3):
                information[i, a, b] -= weight * d[a] * d[b]
        distances[i, 0] += 1.0
        distances[i, 1] += r
    return information, rays, distances


@kernel
def off_sigmas(points: ObservedPoints, i: int, plane: FloatArray, noise: Noise) -> float:
    """Distance of point i to a plane (4,) in standard deviations; infinite beyond the noise's limit and for points seen
    from behind."""
    a, b, e = plane[0], plane[1], plane[2]
    if a * points.views[i, 0] + b * points.views[i, 1] + e * points.views[i, 2] <= _MIN_FACING:
        return np.inf
    r = abs(a * points.world[i, 0] + b * points.world[i, 1] + e * points.world[i, 2] - plane[3])
    if not r <= noise.limit:
        return np.inf
    return float(r / math.sqrt(noise.floor * noise.floor + variance_along(points.covariances[i], a, b, e)))


@kernel
def deviations(points: ObservedPoints, rows: IntArray, plane: FloatArray, noise: Noise) -> FloatArray:
    """(R,) distances of some points (rows) to a plane (4,) in standard deviations; infinite where a point cannot belong
    to it: too far off, or seen from behind."""
    out = np.empty(rows.shape[0])
    for k in range(rows.shape[0]):
        out[k] = off_sigmas(points, rows[k], plane, noise)
    return out


@kernel
def residuals(points: ObservedPoints, rows: IntArray, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R,) signed distances [m] of some points (rows) to a plane (4,), infinite for those seen from behind, and (R,)
    variances [m2] of their own noise along its normal."""
    off, variance = np.full(rows.shape[0], np.inf), np.zeros(rows.shape[0])
    a, b, e = plane[0], plane[1], plane[2]
    for k in range(rows.shape[0]):
        i = rows[k]
        variance[k] = variance_along(points.covariances[i], a, b, e)
        if a * points.views[i, 0] + b * points.views[i, 1] + e * points.views[i, 2] > _MIN_FACING:
            off[k] = a * points.world[i, 0] + b * points.world[i, 1] + e * points.world[i, 2] - plane[3]
    return off, variance


@kernel
def first_accepted(
    points: ObservedPoints, first: IntArray, candidates: IntArray, luck: FloatArray, across: int, reach: float,
    apart: float,
) -> IntArray:  # fmt: skip
    """(M,) the first accepted candidate of each point ``first`` (M,), from (M, T), rows of points; -1 where none is
    accepted.

    A candidate at distance d is accepted when its luck (M, T), from 0 to 1, is below exp(-d^2 / reach^2) and its
    distance over the first ``across`` coordinates is above ``apart`` and two standard deviations of both."""
    m, tries = candidates.shape
    chosen = np.full(m, -1)
    for i in range(m):
        a = first[i]
        for t in range(tries):
            b = candidates[i, t]
            least = max(apart, 2.0 * max(points.sigma[a], points.sigma[b]))
            squares = 0.0
            for k in range(across):
                squares += (points.world[b, k] - points.world[a, k]) ** 2
            if squares <= least * least:
                continue
            for k in range(across, 3):
                squares += (points.world[b, k] - points.world[a, k]) ** 2
            if luck[i, t] < math.exp(-squares / (reach * reach)):
                chosen[i] = b
                break
    return chosen


@kernel
def plane_preferences(points: ObservedPoints, planes: FloatArray, noise: Noise) -> NDArray[np.uint64]:
    """(N, W) uint64: bit h of a point is set when it lies on plane h of (M, 4), unit normal and offset, within its own
    noise, and was seen from the plane's front."""
    n, m = points.world.shape[0], planes.shape[0]
    floor, gate, limit = noise
    preferences = np.zeros((n, (m + WORD - 1) // WORD), np.uint64)
    for i in range(n):
        x, y, z = points.world[i]
        vx, vy, vz = points.views[i]
        c = points.covariances[i]
        for h in range(m):
            a, b, e = planes[h, 0], planes[h, 1], planes[h, 2]
            if a * vx + b * vy + e * vz <= _MIN_FACING:
                continue
            r = abs(a * x + b * y + e * z - planes[h, 3])
            if r <= limit and r <= gate * math.sqrt(floor * floor + variance_along(c, a, b, e)):
                preferences[i, h // WORD] |= np.uint64(1) << np.uint64(h % WORD)
    return preferences
