"""Absolute factor of a robot whose wheels never leave the floor: height, roll and pitch of its base against zero.

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world. Beyond HUBER standard deviations a factor pulls
linearly, so that a sill or a lift by hand does not bend the map.
"""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.slam.schur import Pattern

HUBER = 5.0
HOLD = 1e12


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
    return Floor(np.zeros(0, np.int64), np.eye(3), np.zeros(3), np.ones(3), -1)


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
    J[3] = axis[1] * c[2] - axis[2] * c[1]
    J[4] = axis[2] * c[0] - axis[0] * c[2]
    J[5] = axis[0] * c[1] - axis[1] * c[0]


@kernel
def floor_jacobian(R: FloatArray, floor: Floor) -> FloatArray:
    """(3, 6) derivative of ``floor_residual`` by the frame's perturbation; exact."""
    M, up = floor.R_base_cam, R[:, 2]
    J = np.zeros((3, 6))
    _position_row(up, floor.base_in_cam, J[0])
    for row in range(2):
        J[1 + row, 3] = up[1] * M[row, 2] - up[2] * M[row, 1]
        J[1 + row, 4] = up[2] * M[row, 0] - up[0] * M[row, 2]
        J[1 + row, 5] = up[0] * M[row, 1] - up[1] * M[row, 0]
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
    """Forbid the anchor what the floor does not tell (x, y and yaw): the world's place. Call after the damping, which
    would else take the stiffness for a scale."""
    if floor.anchor < 0 or pattern.number[floor.anchor] < 0:
        return
    A = R[floor.anchor]
    J = np.zeros((3, 6))
    _position_row(A[:, 0], floor.base_in_cam, J[0])
    _position_row(A[:, 1], floor.base_in_cam, J[1])
    for k in range(3):
        J[2, 3 + k] = A[k, 2]
    _add_rows(blocks[pattern.begin[pattern.number[floor.anchor]]], J, HOLD)
