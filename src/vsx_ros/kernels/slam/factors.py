"""Factors between frames of a bundle adjustment besides points: relative poses (wheel odometry), and the floor on which
a robot stands (height, roll and pitch of its base are zero).

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world. Beyond HUBER standard deviations a factor's cost is
linear, so that a slip, a sill or a lift by hand does not bend the map."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry import cross, log_se3
from vsx_ros.kernels.slam.schur import Pattern

HUBER, HOLD = 5.0, 1e12


class Factors(NamedTuple):
    """E measured poses T_a_b between frames: a (E,), b (E,) the frames, R (E, 3, 3) and t (E, 3) the measurement,
    information (E, 6, 6) in the tangent of ``relative_residual``."""

    a: IntArray
    b: IntArray
    R: FloatArray
    t: FloatArray
    information: FloatArray


def no_factors() -> Factors:
    """No measurements between frames."""
    none = np.zeros(0, np.int64)
    return Factors(a=none, b=none, R=np.zeros((0, 3, 3)), t=np.zeros((0, 3)), information=np.zeros((0, 6, 6)))


@kernel
def relative_residual(
    Ra: FloatArray, ta: FloatArray, Rb: FloatArray, tb: FloatArray, Zr: FloatArray, zt: FloatArray
) -> FloatArray:
    """(6,) log(Z^-1 T_a_world T_b_world^-1): how far two frames are from their measured relative pose Z = T_a_b."""
    Rab, tab = np.empty((3, 3)), np.empty(3)
    E, e = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            Rab[i, j] = Ra[i, 0] * Rb[j, 0] + Ra[i, 1] * Rb[j, 1] + Ra[i, 2] * Rb[j, 2]
        tab[i] = ta[i] - (Rab[i, 0] * tb[0] + Rab[i, 1] * tb[1] + Rab[i, 2] * tb[2]) - zt[i]
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
    left, right, adjoint = _bracket(xi, -0.5), _bracket(xi, 0.5), np.zeros((6, 6))
    s = np.array([Zr[0, j] * zt[0] + Zr[1, j] * zt[1] + Zr[2, j] * zt[2] for j in range(3)])
    for i in range(3):
        for j in range(3):
            adjoint[i, j] = Zr[j, i]
            adjoint[3 + i, 3 + j] = Zr[j, i]
        cross(Zr[i], s, adjoint[:3, 3 + i])
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


class Floor(NamedTuple):
    """Which frames (N,) stand on the floor z = 0, R_base_cam (3, 3), the base's origin in the camera (3,) [m], standard
    deviations (3,) of height [m] and tilt [rad] twice, and the frame that keeps its x, y and yaw when it is free
    (-1: none)."""

    frames: IntArray
    R_base_cam: FloatArray
    base_in_cam: FloatArray
    sigma: FloatArray
    anchor: int


def no_floor() -> Floor:
    """Nothing is known about a floor."""
    return Floor(
        frames=np.zeros(0, np.int64), R_base_cam=np.eye(3), base_in_cam=np.zeros(3), sigma=np.ones(3), anchor=-1
    )


@kernel
def floor_residual(R: FloatArray, t: FloatArray, floor: Floor) -> FloatArray:
    """(3,) height of the base [m] and its tilt [rad] (world's up in the base: x, y) in standard deviations."""
    M, c = floor.R_base_cam, floor.base_in_cam
    r = np.zeros(3)
    for k in range(3):
        r[0] += R[k, 2] * (c[k] - t[k])
        r[1] += M[0, k] * R[k, 2]
        r[2] += M[1, k] * R[k, 2]
    for k in range(3):
        r[k] /= floor.sigma[k]
    return r


@kernel
def _position_row(axis: FloatArray, c: FloatArray, J: FloatArray) -> None:
    """Fill J (6,): derivative of the base's world coordinate along an axis, which is given in the camera."""
    J[0], J[1], J[2] = -axis[0], -axis[1], -axis[2]
    cross(axis, c, J[3:])


@kernel
def floor_jacobian(R: FloatArray, floor: Floor) -> FloatArray:
    """(3, 6) derivative of ``floor_residual`` by the frame's perturbation; exact."""
    M, up = floor.R_base_cam, R[:, 2]
    J = np.zeros((3, 6))
    _position_row(up, floor.base_in_cam, J[0])
    for row in range(2):
        cross(up, M[row], J[1 + row, 3:])
    for k in range(3):
        for j in range(6):
            J[k, j] /= floor.sigma[k]
    return J


@kernel
def floor_cost(R: FloatArray, t: FloatArray, floor: Floor) -> float:
    """Half the squared error of all frames on the floor, linear beyond HUBER deviations."""
    total = 0.0
    for f in floor.frames:
        r = floor_residual(R[f], t[f], floor)
        m = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        total += 0.5 * m * m if m <= HUBER else HUBER * (m - 0.5 * HUBER)
    return total


@kernel
def _add_rows(block: FloatArray, J: FloatArray, weight: float) -> None:
    """Add weight J^T J to the upper triangle of a block (6, 6)."""
    for k in range(J.shape[0]):
        for a in range(6):
            for b in range(a, 6):
                block[a, b] += weight * J[k, a] * J[k, b]


@kernel
def add_floor(blocks: FloatArray, g: FloatArray, R: FloatArray, t: FloatArray, pattern: Pattern, floor: Floor) -> None:
    """Add the floor to the blocks of the frames' system (see ``schur.Pattern``) and its right-hand side g (n, 6)."""
    for f in floor.frames:
        i = pattern.number[f]
        if i < 0:
            continue
        r = floor_residual(R[f], t[f], floor)
        m = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        weight = 1.0 if m <= HUBER else HUBER / m
        J = floor_jacobian(R[f], floor)
        _add_rows(blocks[pattern.begin[i]], J, weight)
        for a in range(6):
            for k in range(3):
                g[i, a] -= weight * J[k, a] * r[k]


@kernel
def hold_anchor(blocks: FloatArray, R: FloatArray, pattern: Pattern, floor: Floor) -> None:
    """Fix the anchor where the floor does not (x, y and yaw): it defines the world. Call after the damping, which would
    otherwise scale with the stiffness."""
    if floor.anchor < 0 or pattern.number[floor.anchor] < 0:
        return
    A = R[floor.anchor]
    J = np.zeros((3, 6))
    _position_row(A[:, 0], floor.base_in_cam, J[0])
    _position_row(A[:, 1], floor.base_in_cam, J[1])
    for k in range(3):
        J[2, 3 + k] = A[k, 2]
    _add_rows(blocks[pattern.begin[pattern.number[floor.anchor]]], J, HOLD)
