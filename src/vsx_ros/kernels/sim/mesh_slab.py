"""Triangles between two heights, as polygons on the floor."""

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def _clip(polygon: FloatArray, n: int, height: float, sign: float, out: FloatArray) -> int:
    """The part of a polygon (n, 3) with sign * (z - height) >= 0 into out; returns the number of its corners."""
    m = 0
    for i in range(n):
        j = (i + 1) % n
        a, b = sign * (polygon[i, 2] - height), sign * (polygon[j, 2] - height)
        if a >= 0.0:
            out[m] = polygon[i]
            m += 1
        if (a >= 0.0) != (b >= 0.0):
            share = a / (a - b)
            for axis in range(3):
                out[m, axis] = polygon[i, axis] + share * (polygon[j, axis] - polygon[i, axis])
            m += 1
    return m


@kernel
def slab_polygons(triangles: FloatArray, z_min: float, z_max: float) -> tuple[FloatArray, IntArray, IntArray]:
    """Polygons (M, 5, 2) that the triangles (N, 3, 3) leave between the heights, how many corners each has (M,), and
    the triangle (M,) of each [m]."""
    n = triangles.shape[0]
    polygons, counts, owners = np.empty((n, 5, 2)), np.empty(n, np.int64), np.empty(n, np.int64)
    above, inside = np.empty((6, 3)), np.empty((6, 3))
    m = 0
    for t in range(n):
        z = triangles[t, :, 2]
        if z.max() < z_min or z.min() > z_max:
            continue
        count = _clip(above, _clip(triangles[t], 3, z_min, 1.0, above), z_max, -1.0, inside)
        if count < 3:
            continue
        for i in range(count):
            polygons[m, i, 0], polygons[m, i, 1] = inside[i, 0], inside[i, 1]
        counts[m], owners[m] = count, t
        m += 1
    return polygons[:m], counts[:m], owners[:m]
