"""Points and planes: how well points are known, which planes they prefer, and the sums that planes are fitted from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.jlinkage import WORD

_MIN_FACING = 0.05
_NO_CUTOFF = 1e9
LEVEL = math.cos(math.radians(15.0))
"""Planes whose normal is this much upwards are level."""


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
def best_planes(
    points: Any, covariances: Any, views: Any, planes: Any, axes: Any, boxes: Any, few: int, order: Any, limits: Any
) -> Any:
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
            sigma = r / math.sqrt(floor * floor + _variance(covariances[i], a, b, e))
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
def _choose(i: int, owner: Any, size: Any, gone: Any, begin: Any, near: Any, sigmas: Any) -> None:
    """Give point i to the plane near it that it fits best, of those that are not gone."""
    best, owner[i] = np.inf, -1
    for j in range(begin[i], begin[i + 1]):
        if sigmas[j] < best and not gone[near[j]]:
            best, owner[i] = sigmas[j], near[j]
    if owner[i] >= 0:
        size[owner[i]] += 1


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
def in_plane_axes(x: float, y: float, z: float) -> Any:
    """(2, 3) right and up of a plane with the unit normal (x, y, z): up is the direction in the plane nearest to +z, or
    to +y for a level plane."""
    if abs(z) >= LEVEL:
        ux, uy, uz = -x * y, 1.0 - y * y, -z * y
    else:
        ux, uy, uz = -x * z, -y * z, 1.0 - z * z
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    return np.array([[uy * z - uz * y, uz * x - ux * z, ux * y - uy * x], [ux, uy, uz]])


@kernel
def fit_plane(
    points: Any, covariances: Any, rows: Any, guess: Any, fixed: int, floor: float, cutoff: float, rounds: int
) -> Any:
    """Gauss-Newton on two tilts and the offset of the plane of some points (rows), Tukey's weights from the second
    round on.

    guess: (3,) unit normal. fixed: 0 where the plane may tilt about right and about up, 1 about up only, 2 not at all.
    floor, cutoff: see ``plane_moments``. Returns whether the points determine a plane, plane (4,), covariance (3, 3) of
    tilts and offset, weighted middle (3,), and standard deviations [m] of the points along right and up (2,).
    """
    plane = np.array([guess[0], guess[1], guess[2], 0.0])
    normal, slopes, H, g = plane[:3], np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2)
    covariance, spread = np.zeros((3, 3)), np.zeros(2)
    for turn in range(rounds):
        total, middle, scatter = plane_moments(points, covariances, rows, plane, floor, cutoff if turn else _NO_CUTOFF)
        axes = in_plane_axes(normal[0], normal[1], normal[2])
        # How the distance of a point changes as the plane tilts about right, then about up.
        slopes[0], slopes[1] = -axes[1], axes[0]
        for a in range(2):
            g[a] = _between(slopes[a], scatter, normal)
            for b in range(2):
                H[a, b] = _between(slopes[a], scatter, slopes[b])
        for a in range(fixed):
            g[a] = H[0, 1] = H[1, 0] = 0.0
            H[a, a] = 1.0
        determinant, scale = H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0], H[0, 0] * H[1, 1]
        if not (total > 0.0 and scale > 0.0 and determinant > 1e-12 * scale):
            return False, plane, covariance, middle, spread
        right, up = (H[1, 1] * g[0] - H[0, 1] * g[1]) / determinant, (H[0, 0] * g[1] - H[1, 0] * g[0]) / determinant
        for j in range(3):
            normal[j] -= right * slopes[0, j] + up * slopes[1, j]
        length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for j in range(3):
            normal[j] /= length
        plane[3] = normal[0] * middle[0] + normal[1] * middle[1] + normal[2] * middle[2]
    if fixed < 1:
        covariance[0, 0], covariance[0, 1], covariance[1, 0] = H[1, 1], -H[0, 1], -H[1, 0]
    if fixed < 2:
        covariance[1, 1] = H[0, 0]
    covariance /= determinant
    covariance[2, 2] = 1.0 / total + floor * floor
    for a in range(2):
        spread[a] = math.sqrt(max(0.0, _between(axes[a], scatter, axes[a])) / total)
    return True, plane, covariance, middle, spread


@kernel
def _between(a: Any, M: Any, b: Any) -> float:
    """a M b for vectors (3,) and a matrix (3, 3)."""
    total = 0.0
    for j in range(3):
        total += a[j] * (M[j, 0] * b[0] + M[j, 1] * b[1] + M[j, 2] * b[2])
    return total


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
