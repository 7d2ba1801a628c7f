"""Points and planes: how well points are known, and which planes they prefer."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.jlinkage import WORD

_MIN_FACING = 0.05


@kernel
def variance_along(c: FloatArray, a: float, b: float, e: float) -> float:
    """Of a point with covariance c (3, 3) along the unit vector (a, b, e)."""
    variance: float = (
        a * a * c[0, 0] + b * b * c[1, 1] + e * e * c[2, 2]
        + 2.0 * (a * b * c[0, 1] + a * e * c[0, 2] + b * e * c[1, 2])
    )  # fmt: skip
    return variance


@kernel
def point_information(
    points: FloatArray, centres: FloatArray, obs_keyframe: IntArray, obs_point: IntArray, obs_noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, 3, 3) information [1/m2], (N, 3) sums of unit rays to the observers and (N, 2) counts and sums of distances.

    An observation from distance r along the unit ray d adds (I - d d^T) / (r s)^2, s its noise [rad] obs_noise (O,):
    across the ray it is sharp, along the ray it is blind, so that parallax alone tells the depth.
    """
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
def deviations(
    points: FloatArray,
    covariances: FloatArray,
    views: FloatArray,
    rows: IntArray,
    plane: FloatArray,
    floor: float,
    limit: float,
) -> FloatArray:
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
            out[k] = r / math.sqrt(floor * floor + variance_along(covariances[i], a, b, e))
    return out


@kernel
def best_planes(
    points: FloatArray,
    covariances: FloatArray,
    views: FloatArray,
    planes: FloatArray,
    axes: FloatArray,
    boxes: FloatArray,
    few: int,
    order: IntArray,
    limits: tuple[float, float, float],
) -> IntArray:
    """(N,) the plane of (G, 4) that each point fits best, of those it lies beside; -1 where it fits none.

    Planes with fewer than ``few`` points leave them to the others, one at a time by their place in order (G,).
    axes: (G, 2, 3). boxes: (G, 2, 2) least and greatest coordinates along them [m]. limits: floor [m], gate, limit [m];
    see ``deviations``.
    """
    floor, gate, limit = limits
    n, m = points.shape[0], planes.shape[0]
    begin = np.zeros(n + 1, np.int64)
    near, sigmas = np.empty(4 * n, np.int64), np.empty(4 * n)
    count = 0
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(m):
            a, b, e = planes[k, 0], planes[k, 1], planes[k, 2]
            r = abs(a * x + b * y + e * z - planes[k, 3])
            if r > limit or a * views[i, 0] + b * views[i, 1] + e * views[i, 2] <= _MIN_FACING:
                continue
            u = axes[k, 0, 0] * x + axes[k, 0, 1] * y + axes[k, 0, 2] * z
            v = axes[k, 1, 0] * x + axes[k, 1, 1] * y + axes[k, 1, 2] * z
            if u < boxes[k, 0, 0] or u > boxes[k, 1, 0] or v < boxes[k, 0, 1] or v > boxes[k, 1, 1]:
                continue
            sigma = r / math.sqrt(floor * floor + variance_along(covariances[i], a, b, e))
            if sigma >= gate:
                continue
            if count == near.shape[0]:
                near, sigmas = np.concatenate((near, near)), np.concatenate((sigmas, sigmas))
            near[count], sigmas[count] = k, sigma
            count += 1
        begin[i + 1] = count
    owner, gone, size = np.full(n, -1), np.zeros(m, np.bool_), np.zeros(m, np.int64)
    for i in range(n):
        _choose(i, owner, size, gone, begin, near, sigmas)
    while True:
        left = -1
        for k in order:
            if 0 < size[k] < few:
                left = k
                break
        if left < 0:
            return owner
        gone[left] = True
        for i in range(n):
            if owner[i] == left:
                _choose(i, owner, size, gone, begin, near, sigmas)
        size[left] = 0


@kernel
def _choose(
    i: int, owner: IntArray, size: IntArray, gone: BoolArray, begin: IntArray, near: IntArray, sigmas: FloatArray
) -> None:
    """Give point i to the plane near it that it fits best, of those that are not gone."""
    best, owner[i] = np.inf, -1
    for j in range(begin[i], begin[i + 1]):
        if sigmas[j] < best and not gone[near[j]]:
            best, owner[i] = sigmas[j], near[j]
    if owner[i] >= 0:
        size[owner[i]] += 1


@kernel
def beside(points: FloatArray, axes: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
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
def first_accepted(
    points: FloatArray,
    sigmas: FloatArray,
    first: IntArray,
    candidates: IntArray,
    luck: FloatArray,
    across: int,
    reach: float,
    apart: float,
) -> IntArray:
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
    points: FloatArray,
    covariances: FloatArray,
    views: FloatArray,
    planes: FloatArray,
    floor: float,
    gate: float,
    limit: float,
) -> NDArray[np.uint64]:
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
            if r <= gate * math.sqrt(floor * floor + variance_along(c, a, b, e)):
                preferences[i, h // WORD] |= np.uint64(1) << np.uint64(h % WORD)
    return preferences
