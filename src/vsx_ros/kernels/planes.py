"""Points and planes: how well points are known, which planes they prefer, and the sums that planes are fitted from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.jlinkage import WORD

_MIN_FACING = 0.05


@kernel
def _variance(c: Any, a: float, b: float, e: float) -> Any:
    """Of a point with covariance c (3, 3) along the unit vector (a, b, e)."""
    return (
        a * a * c[0, 0] + b * b * c[1, 1] + e * e * c[2, 2]
        + 2.0 * (a * b * c[0, 1] + a * e * c[0, 2] + b * e * c[1, 2])
    )  # fmt: skip


@kernel
def point_information(points: Any, centres: Any, obs_keyframe: Any, obs_point: Any, obs_noise: Any) -> Any:
    """(N, 3, 3) information [1/m2], (N, 3) sums of unit rays to the observers and (N, 2) counts and sums of distances.

    An observation from distance r along the unit ray d adds (I - d d^T) / (r s)^2, s its noise [rad] obs_noise (O,):
    across the ray it is sharp, along the ray it is blind, so that parallax alone tells the depth.
    """
    n = points.shape[0]
    information, rays, distances = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 2))
    d = np.empty(3)
    for o in range(obs_point.shape[0]):
        i, k = obs_point[o], obs_keyframe[o]
        d[0], d[1], d[2] = (
            centres[k, 0] - points[i, 0],
            centres[k, 1] - points[i, 1],
            centres[k, 2] - points[i, 2],
        )
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
def deviations(points: Any, covariances: Any, views: Any, rows: Any, plane: Any, floor: float, limit: float) -> Any:
    """(R,) distances of some points (rows) to a plane (4,) in standard deviations; infinite beyond ``limit`` [m] and
    for points seen from behind. floor [m]: noise besides the points' own."""
    out = np.full(rows.shape[0], np.inf)
    a, b, e = plane[0], plane[1], plane[2]
    for k in range(rows.shape[0]):
        i = rows[k]
        if a * views[i, 0] + b * views[i, 1] + e * views[i, 2] <= _MIN_FACING:
            continue
        r = abs(a * points[i, 0] + b * points[i, 1] + e * points[i, 2] - plane[3])
        if r <= limit:
            out[k] = r / math.sqrt(floor * floor + _variance(covariances[i], a, b, e))
    return out


@kernel
def beside(points: Any, axes: Any, low: Any, high: Any) -> Any:
    """Rows of the points (N, 3) whose coordinates along two axes (2, 3) lie between low and high (2,)."""
    rows = np.empty(points.shape[0], np.int64)
    count = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        if u < low[0] or u > high[0]:
            continue
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        if v >= low[1] and v <= high[1]:
            rows[count] = i
            count += 1
    return rows[:count]


@kernel
def plane_moments(points: Any, covariances: Any, rows: Any, plane: Any, floor: float, cutoff: float) -> Any:
    """(total weight, weighted mean (3,), weighted scatter about it (3, 3)) of some points (rows), whose weights are
    inverse variances along a plane's normal (4,) and Tukey's, zero from ``cutoff`` standard deviations on."""
    origin = points[rows[0]].copy()
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    d = np.empty(3)
    a, b, e = plane[0], plane[1], plane[2]
    for i in rows:
        variance = floor * floor + _variance(covariances[i], a, b, e)
        r = a * points[i, 0] + b * points[i, 1] + e * points[i, 2] - plane[3]
        u = 1.0 - r * r / (variance * cutoff * cutoff)
        if u <= 0.0:
            continue
        weight = u * u / variance
        for j in range(3):
            d[j] = points[i, j] - origin[j]
        total += weight
        for j in range(3):
            first[j] += weight * d[j]
            for k in range(3):
                second[j, k] += weight * d[j] * d[k]
    if total <= 0.0:
        return 0.0, origin, second
    for j in range(3):
        first[j] /= total
    for j in range(3):
        for k in range(3):
            second[j, k] -= total * first[j] * first[k]
    return total, origin + first, second


@kernel
def first_accepted(
    points: Any, sigmas: Any, first: Any, candidates: Any, luck: Any, across: int, reach: float, apart: float
) -> Any:
    """(M,) for each point ``first`` (M,) the first of its candidates (M, T), rows of points, that is accepted; -1
    where none is.

    One at a distance d is when its luck (M, T), from 0 to 1, is below exp(-d^2 / reach^2) and it is farther off than
    ``apart`` and than two standard deviations of both, over the first ``across`` coordinates.
    """
    m, tries = candidates.shape
    chosen = np.full(m, -1)
    for i in range(m):
        a = first[i]
        for t in range(tries):
            b = candidates[i, t]
            least = max(apart, 2.0 * max(sigmas[a], sigmas[b]))
            squares = 0.0
            for k in range(across):
                squares += (points[b, k] - points[a, k]) ** 2
            if squares <= least * least:
                continue
            for k in range(across, 3):
                squares += (points[b, k] - points[a, k]) ** 2
            if luck[i, t] < math.exp(-squares / (reach * reach)):
                chosen[i] = b
                break
    return chosen


@kernel
def plane_preferences(
    points: Any, covariances: Any, views: Any, planes: Any, floor: float, gate: float, limit: float
) -> Any:
    """(N, W) uint64: bit h of a point is set where it lies on plane h, as far as its own noise allows.

    points: (N, 3). covariances: (N, 3, 3) of them. views: (N, 3) unit vectors towards those who saw them. planes:
    (M, 4) unit normal and offset. A point may lie ``gate`` standard deviations off, ``limit`` [m] at most, and must
    have been seen from the plane's front.
    """
    n, m = points.shape[0], planes.shape[0]
    preferences = np.zeros((n, (m + WORD - 1) // WORD), np.uint64)
    for i in range(n):
        x, y, z = points[i]
        vx, vy, vz = views[i]
        c = covariances[i]
        for h in range(m):
            a, b, e = planes[h, 0], planes[h, 1], planes[h, 2]
            if a * vx + b * vy + e * vz <= _MIN_FACING:
                continue
            r = abs(a * x + b * y + e * z - planes[h, 3])
            if r > limit:
                continue
            if r <= gate * math.sqrt(floor * floor + _variance(c, a, b, e)):
                preferences[i, h // WORD] |= np.uint64(1) << np.uint64(h % WORD)
    return preferences
