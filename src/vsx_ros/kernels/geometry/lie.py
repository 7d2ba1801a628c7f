"""The group SE(3): points, exponential, logarithm, product. Tangent vectors are xi = (rho, omega)."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.kernels import kernel, part


@kernel
def exp_se3(xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) of the tangent vector (6,)."""
    wx, wy, wz = xi[3], xi[4], xi[5]
    angle2 = wx * wx + wy * wy + wz * wz
    if angle2 < 1e-10:
        a, b, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = math.sqrt(angle2)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / angle2
        c = (1.0 - a) / angle2
    W = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    R = np.empty((3, 3))
    t = np.zeros(3)
    for i in range(3):
        for j in range(3):
            w2 = W[i, 0] * W[0, j] + W[i, 1] * W[1, j] + W[i, 2] * W[2, j]
            unit = 1.0 if i == j else 0.0
            R[i, j] = unit + a * W[i, j] + b * w2
            t[i] += (unit + b * W[i, j] + c * w2) * xi[j]
    return R, t


@part
def transform(R: FloatArray, t: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The point (x, y, z) after the rigid motion R, t."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0],
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1],
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2],
    )


@part
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Fill out (3,) with the cross product of two vectors (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def compose(Ra: FloatArray, ta: FloatArray, Rb: FloatArray, tb: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, t) of the product of two rigid motions."""
    R = np.empty((3, 3))
    t = np.empty(3)
    for i in range(3):
        for j in range(3):
            R[i, j] = Ra[i, 0] * Rb[0, j] + Ra[i, 1] * Rb[1, j] + Ra[i, 2] * Rb[2, j]
        t[i] = Ra[i, 0] * tb[0] + Ra[i, 1] * tb[1] + Ra[i, 2] * tb[2] + ta[i]
    return R, t


@kernel
def orthonormalize(R: FloatArray) -> None:
    """Make the rows of a nearly orthonormal (3, 3) matrix exactly so, in place.

    Poses are composed thousands of times from one another; without this the rounding errors multiply.
    """
    for i in range(3):
        for k in range(i):
            dot = R[i, 0] * R[k, 0] + R[i, 1] * R[k, 1] + R[i, 2] * R[k, 2]
            for j in range(3):
                R[i, j] -= dot * R[k, j]
        norm = math.sqrt(R[i, 0] * R[i, 0] + R[i, 1] * R[i, 1] + R[i, 2] * R[i, 2])
        for j in range(3):
            R[i, j] /= norm


@kernel
def log_se3(R: FloatArray, t: FloatArray) -> FloatArray:
    """Tangent vector (6,) of a rigid motion whose rotation stays well below pi."""
    xi = np.empty(6)
    sx, sy, sz = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(sx * sx + sy * sy + sz * sz)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    k = 1.0 if sine < 1e-9 else angle / sine
    wx, wy, wz = k * sx, k * sy, k * sz
    if angle < 1e-5:
        c = 1.0 / 12.0
    else:
        c = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    cx, cy, cz = wy * t[2] - wz * t[1], wz * t[0] - wx * t[2], wx * t[1] - wy * t[0]
    xi[0] = t[0] - 0.5 * cx + c * (wy * cz - wz * cy)
    xi[1] = t[1] - 0.5 * cy + c * (wz * cx - wx * cz)
    xi[2] = t[2] - 0.5 * cz + c * (wx * cy - wy * cx)
    xi[3], xi[4], xi[5] = wx, wy, wz
    return xi
