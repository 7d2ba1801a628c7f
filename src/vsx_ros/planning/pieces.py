"""The pieces a path is made of: a table of exact knots between which it is interpolated.

Columns of a table: arc length s from the start of the piece [m], x, y [m], theta [rad, unwrapped], and curvature
kappa = dtheta/ds [rad/m] with s counted positive in both driving directions."""

import math
from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.planning.curves import arc_table, curve_table
from vsx_ros.planning.flat_output import FINE

_ARC_STEP_M, _ARC_STEP_RAD = 0.02, 0.02  # between the samples of an arc: chords are 0.05 mm off at most (phi 1 rad/m)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A stretch driven in one direction: +1 forward, -1 reverse, 0 turning on the spot.

    table (M >= 2, 5): s, x, y, theta, kappa at knots, s not decreasing; kappa is 0 in a turn on the spot.
    curvature_bound: proved upper bound of |kappa| over the piece [rad/m], infinite in a turn on the spot."""

    direction: int
    table: FloatArray
    curvature_bound: float

    @property
    def length_m(self) -> float:
        """Arc length [m]."""
        return float(self.table[-1, 0])

    @property
    def turn_rad(self) -> float:
        """Signed heading change [rad]."""
        return float(self.table[-1, 3] - self.table[0, 3])

    @property
    def start(self) -> SE2:
        """The first pose."""
        return SE2(*(float(v) for v in self.table[0, 1:4]))

    @property
    def end(self) -> SE2:
        """The last pose; theta unwrapped along the piece."""
        return SE2(*(float(v) for v in self.table[-1, 1:4]))

    def at(self, s: FloatArray) -> FloatArray:
        """(N, 5) x, y, theta, kappa, direction at arc lengths s (N,) [m], held at the ends.

        Cubic Hermite between the knots, whose tangents are exact; not for turns on the spot."""
        s = np.clip(np.asarray(s, float), 0.0, self.length_m)
        knots = self.table[:, 0]
        i = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2)
        a, b = self.table[i], self.table[i + 1]
        h = np.maximum(b[:, :1] - a[:, :1], 1e-300)
        u = (s[:, None] - a[:, :1]) / h
        p, q = a[:, 1:4], b[:, 1:4]
        da, db = (
            np.column_stack([self.direction * np.cos(k[:, 3]), self.direction * np.sin(k[:, 3]), k[:, 4]])
            for k in (a, b)
        )
        out = np.empty((len(s), 5))
        out[:, :3] = p + u * u * (3.0 - 2.0 * u) * (q - p) + h * u * (1.0 - u) * ((1.0 - u) * da - u * db)
        out[:, 3] = a[:, 4] + u[:, 0] * (b[:, 4] - a[:, 4])
        out[:, 4] = self.direction
        return out


def arc_piece(start: SE2, kappa: float, length_m: float, direction: int) -> Piece:
    """A circular arc or straight line; kappa = dtheta/ds [rad/m], length positive."""
    steps = max(1, math.ceil(length_m / _ARC_STEP_M), math.ceil(abs(kappa) * length_m / _ARC_STEP_RAD))
    table = arc_table(start.x, start.y, start.theta, kappa, length_m, direction, steps)
    return Piece(direction, table, abs(kappa))


def turn_piece(start: SE2, angle: float) -> Piece:
    """A turn on the spot by the signed angle [rad]. The generic planner uses it, ``Planner`` only without a map."""
    table = np.array([[0.0, start.x, start.y, start.theta, 0.0], [0.0, start.x, start.y, start.theta + angle, 0.0]])
    return Piece(0, table, math.inf)


def curve_piece(
    start: SE2, turn: float, direction: int, coefficients: FloatArray, joints: tuple[bool, bool], bound: float
) -> Piece:
    """The polynomial curve of the certified method: theta = theta_0 + turn S(t), rho = basis @ coefficients (10,).

    joints: whether the path continues before and after, bending the other way. bound: proved by ``curvature_bound``."""
    table = curve_table(
        start.as_array(), turn, direction, np.ascontiguousarray(coefficients), FINE.basis[joints],
        FINE.profile[joints], FINE.weights, FINE.order, FINE.knot_jacobi, FINE.knot_profile[joints],
        FINE.knot_turn_rate[joints],
    )  # fmt: skip
    return Piece(direction, table, bound)
