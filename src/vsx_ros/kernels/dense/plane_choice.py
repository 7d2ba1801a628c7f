"""Which of several planes each point belongs to."""

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, off_sigmas


@kernel
def _bounds(planes: FloatArray, axes: FloatArray, boxes: FloatArray, limit: float) -> FloatArray:
    """(G, 2, 3) least and greatest world coordinates, or a little beyond, of points nearer than limit [m] to planes
    (G, 4) and between boxes (G, 2, 2) along axes (G, 2, 3)."""
    bounds = np.empty((planes.shape[0], 2, 3))
    for k in range(planes.shape[0]):
        for c in range(3):
            middle, half = planes[k, 3] * planes[k, c], abs(planes[k, c]) * limit
            for j in range(2):
                middle += axes[k, j, c] * 0.5 * (boxes[k, 0, j] + boxes[k, 1, j])
                half += abs(axes[k, j, c]) * 0.5 * (boxes[k, 1, j] - boxes[k, 0, j])
            half += 1e-6 * (half + abs(middle))
            bounds[k, 0, c], bounds[k, 1, c] = middle - half, middle + half
    return bounds


@kernel
def _is_beside(point: FloatArray, axes: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    """Whether a point's (3,) coordinates along two axes (2, 3) lie between low and high (2,)."""
    for k in range(2):
        u = axes[k, 0] * point[0] + axes[k, 1] * point[1] + axes[k, 2] * point[2]
        if u < low[k] or u > high[k]:
            return False
    return True


@kernel
def beside(points: FloatArray, axes: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    """Rows of the points (N, 3) whose coordinates along two axes (2, 3) lie between low and high (2,)."""
    rows = np.empty(points.shape[0], np.int64)
    count = 0
    for i in range(points.shape[0]):
        if _is_beside(points[i], axes, low, high):
            rows[count] = i
            count += 1
    return rows[:count]


@kernel
def _near(
    points: ObservedPoints, planes: FloatArray, axes: FloatArray, boxes: FloatArray, noise: Noise
) -> tuple[IntArray, IntArray, FloatArray]:
    """The planes that each of N points fits and lies beside: those of point i are in the rows begin[i] to begin[i + 1]
    of the second array, and its distances to them in standard deviations in the third."""
    n = points.world.shape[0]
    begin = np.zeros(n + 1, np.int64)
    near, sigmas = np.empty(4 * n, np.int64), np.empty(4 * n)
    bounds = _bounds(planes, axes, boxes, noise.limit)
    count = 0
    for i in range(n):
        x, y, z = points.world[i]
        for k in range(planes.shape[0]):
            if x < bounds[k, 0, 0] or x > bounds[k, 1, 0] or y < bounds[k, 0, 1] or y > bounds[k, 1, 1]:
                continue
            if z < bounds[k, 0, 2] or z > bounds[k, 1, 2]:
                continue
            sigma = off_sigmas(points, i, planes[k], noise)
            if sigma >= noise.gate or not _is_beside(points.world[i], axes[k], boxes[k, 0], boxes[k, 1]):
                continue
            if count == near.shape[0]:
                near, sigmas = np.concatenate((near, near)), np.concatenate((sigmas, sigmas))
            near[count], sigmas[count] = k, sigma
            count += 1
        begin[i + 1] = count
    return begin, near[:count], sigmas[:count]


@kernel
def _choose(
    i: int, owner: IntArray, size: IntArray, gone: BoolArray, begin: IntArray, near: IntArray, sigmas: FloatArray
) -> None:
    """Assign point i to the near plane that it fits best, of those that are not gone."""
    best, owner[i] = np.inf, -1
    for j in range(begin[i], begin[i + 1]):
        if sigmas[j] < best and not gone[near[j]]:
            best, owner[i] = sigmas[j], near[j]
    if owner[i] >= 0:
        size[owner[i]] += 1


@kernel
def best_planes(
    points: ObservedPoints, planes: FloatArray, axes: FloatArray, boxes: FloatArray, few: int, order: IntArray,
    noise: Noise,
) -> IntArray:  # fmt: skip
    """(N,) the plane of (G, 4) that each point fits best, of those it lies beside; -1 where none fits.

    Planes with fewer than ``few`` points give them to the others, one plane at a time in the sequence of order (G,).
    axes: (G, 2, 3). boxes: (G, 2, 2) least and greatest coordinates along them [m]."""
    n, m = points.world.shape[0], planes.shape[0]
    begin, near, sigmas = _near(points, planes, axes, boxes, noise)
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
