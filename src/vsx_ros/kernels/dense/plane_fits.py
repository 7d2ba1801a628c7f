"""Fit of a plane to points, and the sums that it uses."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.planes import ObservedPoints, variance_along

_NO_CUTOFF = 1e9
LEVEL = math.cos(math.radians(15.0))  # least |z| of a level plane's normal


@kernel
def plane_moments(
    points: ObservedPoints, rows: IntArray, plane: FloatArray, floor: float, cutoff: float
) -> tuple[float, FloatArray, FloatArray]:
    """(total weight, weighted mean (3,), weighted scatter about it (3, 3)) of some points (rows). Weights: inverse
    variance along a plane's normal (4,) times Tukey weight, zero from ``cutoff`` standard deviations on."""
    world, covariances = points.world, points.covariances
    origin = world[rows[0]].copy()
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    d = np.empty(3)
    a, b, e = plane[0], plane[1], plane[2]
    for i in rows:
        variance = floor * floor + variance_along(covariances[i], a, b, e)
        r = a * world[i, 0] + b * world[i, 1] + e * world[i, 2] - plane[3]
        u = 1.0 - r * r / (variance * cutoff * cutoff)
        if u <= 0.0:
            continue
        weight = u * u / variance
        for j in range(3):
            d[j] = world[i, j] - origin[j]
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
def in_plane_axes(normal: FloatArray) -> FloatArray:
    """(2, 3) right and up of a plane with a unit normal (3,): up is the direction in the plane nearest to +z, or to +y
    for a level plane."""
    x, y, z = normal[0], normal[1], normal[2]
    if abs(z) >= LEVEL:
        ux, uy, uz = -x * y, 1.0 - y * y, -z * y
    else:
        ux, uy, uz = -x * z, -y * z, 1.0 - z * z
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    return np.array([[uy * z - uz * y, uz * x - ux * z, ux * y - uy * x], [ux, uy, uz]])


@kernel
def fit_plane(
    points: ObservedPoints, rows: IntArray, guess: FloatArray, fixed: int, floor: float, cutoff: float, rounds: int
) -> tuple[bool, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton on two tilts and the offset of the plane of some points (rows), with Tukey weights from the second
    round on.

    guess: (3,) unit normal. fixed: 0 where the plane may tilt about right and about up, 1 about up only, 2 not at all.
    floor, cutoff: see ``plane_moments``. Returns whether the points determine a plane, plane (4,), covariance (3, 3) of
    tilts and offset, weighted mean (3,), and standard deviations [m] of the points along right and up (2,)."""
    plane = np.array([guess[0], guess[1], guess[2], 0.0])
    normal, slopes, H, g = plane[:3], np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2)
    covariance, spread = np.zeros((3, 3)), np.zeros(2)
    for turn in range(rounds):
        total, middle, scatter = plane_moments(points, rows, plane, floor, cutoff if turn else _NO_CUTOFF)
        axes = in_plane_axes(normal)
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
        _tilt(normal, slopes, right, up)
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
def _tilt(normal: FloatArray, slopes: FloatArray, right: float, up: float) -> None:
    """Tilt a unit normal (3,) in place by small angles, whose slopes (2, 3) are given."""
    for j in range(3):
        normal[j] -= right * slopes[0, j] + up * slopes[1, j]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for j in range(3):
        normal[j] /= length


@kernel
def _between(a: FloatArray, M: FloatArray, b: FloatArray) -> float:
    """a M b for vectors (3,) and a matrix (3, 3)."""
    total = 0.0
    for j in range(3):
        total += a[j] * (M[j, 0] * b[0] + M[j, 1] * b[1] + M[j, 2] * b[2])
    return total
