"""Relative-pose factors between frames (wheel odometry): residual, derivatives, and their share in a bundle
adjustment.

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world. Beyond HUBER standard deviations a factor pulls
linearly.
"""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry.lie import log_se3
from vsx_ros.kernels.slam.schur import Pattern

HUBER = 5.0


class Factors(NamedTuple):
    """E measured poses T_a_b between frames: a (E,), b (E,) the frames, R (E, 3, 3) and t (E, 3) the measurement,
    information (E, 6, 6) in the tangent of ``relative_residual``."""

    a: IntArray
    b: IntArray
    R: FloatArray
    t: FloatArray
    information: FloatArray


def no_factors() -> Factors:
    """Nothing is measured between frames."""
    none = np.zeros(0, np.int64)
    return Factors(none, none, np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 6, 6)))


@kernel
def relative_residual(
    Ra: FloatArray, ta: FloatArray, Rb: FloatArray, tb: FloatArray, Zr: FloatArray, zt: FloatArray
) -> FloatArray:
    """(6,) log(Z^-1 T_a_world T_b_world^-1): how far two frames are from their measured relative pose Z = T_a_b."""
    Rab = np.empty((3, 3))
    tab = np.empty(3)
    for i in range(3):
        for j in range(3):
            Rab[i, j] = Ra[i, 0] * Rb[j, 0] + Ra[i, 1] * Rb[j, 1] + Ra[i, 2] * Rb[j, 2]
    for i in range(3):
        tab[i] = ta[i] - (Rab[i, 0] * tb[0] + Rab[i, 1] * tb[1] + Rab[i, 2] * tb[2]) - zt[i]
    E = np.empty((3, 3))
    e = np.empty(3)
    for i in range(3):
        for j in range(3):
            E[i, j] = Zr[0, i] * Rab[0, j] + Zr[1, i] * Rab[1, j] + Zr[2, i] * Rab[2, j]
        e[i] = Zr[0, i] * tab[0] + Zr[1, i] * tab[1] + Zr[2, i] * tab[2]
    return log_se3(E, e)


@kernel
def _bracket(xi: FloatArray, factor: float) -> FloatArray:
    """(6, 6) identity + factor * ad(xi)."""
    A = np.zeros((6, 6))
    for block in range(2):
        o = 3 * block
        A[o, o + 1], A[o, o + 2] = -xi[5], xi[4]
        A[o + 1, o], A[o + 1, o + 2] = xi[5], -xi[3]
        A[o + 2, o], A[o + 2, o + 1] = -xi[4], xi[3]
    A[0, 4], A[0, 5] = -xi[2], xi[1]
    A[1, 3], A[1, 5] = xi[2], -xi[0]
    A[2, 3], A[2, 4] = -xi[1], xi[0]
    for i in range(6):
        for j in range(6):
            A[i, j] *= factor
        A[i, i] += 1.0
    return A


@kernel
def relative_jacobians(xi: FloatArray, Zr: FloatArray, zt: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(6, 6) derivatives of ``relative_residual`` (value xi) by the perturbations of frames a and b, second order in
    xi."""
    left = _bracket(xi, -0.5)
    right = _bracket(xi, 0.5)
    adjoint = np.zeros((6, 6))
    s = np.array(
        [
            Zr[0, 0] * zt[0] + Zr[1, 0] * zt[1] + Zr[2, 0] * zt[2],
            Zr[0, 1] * zt[0] + Zr[1, 1] * zt[1] + Zr[2, 1] * zt[2],
            Zr[0, 2] * zt[0] + Zr[1, 2] * zt[1] + Zr[2, 2] * zt[2],
        ]
    )
    for i in range(3):
        for j in range(3):
            adjoint[i, j] = Zr[j, i]
            adjoint[3 + i, 3 + j] = Zr[j, i]
    for j in range(3):
        c0, c1, c2 = Zr[j, 0], Zr[j, 1], Zr[j, 2]
        adjoint[0, 3 + j] = -(s[1] * c2 - s[2] * c1)
        adjoint[1, 3 + j] = -(s[2] * c0 - s[0] * c2)
        adjoint[2, 3 + j] = -(s[0] * c1 - s[1] * c0)
    Ja = np.zeros((6, 6))
    for i in range(6):
        for k in range(6):
            for j in range(6):
                Ja[i, j] += left[i, k] * adjoint[k, j]
    return Ja, -right


@kernel
def _quadratic(r: FloatArray, info: FloatArray) -> float:
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += r[i] * info[i, j] * r[j]
    return total


@kernel
def factor_cost(R: FloatArray, t: FloatArray, factors: Factors) -> float:
    """Half the squared error of all factors, linear beyond HUBER deviations."""
    total = 0.0
    for f in range(factors.a.shape[0]):
        a, b = factors.a[f], factors.b[f]
        r = relative_residual(R[a], t[a], R[b], t[b], factors.R[f], factors.t[f])
        m = math.sqrt(max(0.0, _quadratic(r, factors.information[f])))
        total += 0.5 * m * m if m <= HUBER else HUBER * (m - 0.5 * HUBER)
    return total


@kernel
def add_factors(
    blocks: FloatArray, g: FloatArray, R: FloatArray, t: FloatArray, pattern: Pattern, factors: Factors
) -> None:
    """Add the factors to the blocks of the frames' system (see ``schur.Pattern``) and its right-hand side g (n, 6)."""
    for f in range(factors.a.shape[0]):
        a, b = factors.a[f], factors.b[f]
        r = relative_residual(R[a], t[a], R[b], t[b], factors.R[f], factors.t[f])
        m = math.sqrt(max(0.0, _quadratic(r, factors.information[f])))
        info = factors.information[f] * (1.0 if m <= HUBER else HUBER / m)
        Ja, Jb = relative_jacobians(r, factors.R[f], factors.t[f])
        for first in range(2):
            J1 = Ja if first == 0 else Jb
            i = pattern.number[a] if first == 0 else pattern.number[b]
            if i < 0:
                continue
            JI = J1.T @ info
            rhs = JI @ r
            for k in range(6):
                g[i, k] -= rhs[k]
            for second in range(2):
                J2 = Ja if second == 0 else Jb
                j = pattern.number[a] if second == 0 else pattern.number[b]
                if j < i:
                    continue
                blocks[pattern.block[i, j]] += JI @ J2
