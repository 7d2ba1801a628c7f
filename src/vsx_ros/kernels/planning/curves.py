"""Tables of knots along arcs, lines and polynomial curves: arc length, x, y, theta, curvature."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def arc_table(x: float, y: float, theta: float, kappa: float, length: float, direction: int, steps: int) -> FloatArray:
    """(steps + 1, 5) knots of an arc of positive length at dtheta/ds = kappa [rad/m], direction +1 or -1."""
    table = np.empty((steps + 1, 5))
    straight = abs(kappa) < 1e-12
    c, s = math.cos(theta), math.sin(theta)
    for i in range(steps + 1):
        d = length if i == steps else i * (length / steps)
        turned = theta + kappa * d
        table[i, 0], table[i, 3], table[i, 4] = d, turned, kappa
        if straight:
            table[i, 1] = x + direction * d * c
            table[i, 2] = y + direction * d * s
        else:
            table[i, 1] = x + direction * (math.sin(turned) - s) / kappa
            table[i, 2] = y - direction * (math.cos(turned) - c) / kappa
    return table


@kernel
def curve_table(
    start: FloatArray, turn: float, direction: int, coefficients: FloatArray, basis: FloatArray, profile: FloatArray,
    weights: FloatArray, order: int, knot_jacobi: FloatArray, knot_profile: FloatArray, knot_turn_rate: FloatArray,
) -> FloatArray:  # fmt: skip
    """(I + 1, 5) knots of the curve theta = theta_0 + turn S(t), ds/dt = basis @ coefficients, from a pose (3,).

    basis (I order, 10), profile (I order,) S, weights (I order,) at the nodes of a quadrature with I intervals;
    knot_jacobi (I + 1, 10), knot_profile (I + 1,) and knot_turn_rate (I + 1,) at its knots."""
    intervals = knot_profile.shape[0] - 1
    table = np.empty((intervals + 1, 5))
    length, x, y = 0.0, 0.0, 0.0
    for i in range(intervals + 1):
        if i > 0:
            for k in range((i - 1) * order, i * order):
                rate = 0.0
                for n in range(coefficients.shape[0]):
                    rate += basis[k, n] * coefficients[n]
                rate *= weights[k]
                angle = start[2] + turn * profile[k]
                length += rate
                x += rate * math.cos(angle)
                y += rate * math.sin(angle)
        rate = 0.0
        for n in range(coefficients.shape[0]):
            rate += knot_jacobi[i, n] * coefficients[n]
        table[i, 0], table[i, 1], table[i, 2] = length, start[0] + direction * x, start[1] + direction * y
        table[i, 3], table[i, 4] = start[2] + turn * knot_profile[i], turn * knot_turn_rate[i] / rate
    return table


@kernel
def position_rows(
    kinds: IntArray, heads: FloatArray, turns: FloatArray, directions: IntArray, basis: FloatArray, profile: FloatArray,
    weights: FloatArray, order: int,
) -> FloatArray:  # fmt: skip
    """(2, I K, C K) rows that give x and y, relative to the start, at the ends of the I intervals of all K pieces.

    The pieces follow each other: kinds (K,) which of the end conditions each has, heads (K,) [rad] where it begins,
    turns (K,) [rad], directions (K,). basis (4, I order, C), profile (4, I order), weights (I order,) of a quadrature.
    """
    k, n, width = kinds.shape[0], weights.shape[0] // order, basis.shape[2]
    rows = np.zeros((2, n * k, width * k))
    for i in range(k):
        x, y = np.zeros(width), np.zeros(width)
        first = width * i
        for node in range(n * order):
            angle = heads[i] + turns[i] * profile[kinds[i], node]
            along_x = directions[i] * weights[node] * math.cos(angle)
            along_y = directions[i] * weights[node] * math.sin(angle)
            for c in range(width):
                x[c] += along_x * basis[kinds[i], node, c]
                y[c] += along_y * basis[kinds[i], node, c]
            if (node + 1) % order == 0:
                at = n * i + node // order
                rows[0, at, first : first + width] = x
                rows[1, at, first : first + width] = y
        for at in range(n * (i + 1), n * k):
            rows[0, at, first : first + width] = x
            rows[1, at, first : first + width] = y
    return rows
