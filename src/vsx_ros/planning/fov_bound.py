"""The bound on the change of view, |dtheta/ds| <= phi (paper eq. 5, 6, 11), made linear and certain.

In (theta, rho) form eq. (5) reads |thetadot| <= phi rho. Both sides share the factor t (1 - t); what remains,
phi p(t) - |q(t)| >= floor, is a polynomial of degree 9 that is linear in the coefficients of rho. Its Bernstein
coefficients on sub-intervals being non-negative proves it for every t, not only on a grid.
"""

from __future__ import annotations

from math import comb

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.planning.flat_output import COEFFICIENTS, jacobi, profile_rate

SUB_INTERVALS = 4


def bernstein_rows(values_at: FloatArray, nodes: FloatArray) -> FloatArray:
    """(10, ...) Bernstein coefficients of degree 9 of the polynomials with values (10, ...) at nodes (10,) in [0, 1]."""
    degree = COEFFICIENTS - 1
    vandermonde = np.stack(
        [comb(degree, j) * nodes**j * (1.0 - nodes) ** (degree - j) for j in range(COEFFICIENTS)], axis=1
    )
    return np.linalg.solve(vandermonde, values_at)


_NODES: FloatArray = 0.5 - 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
_PLACES = [(i + _NODES) / SUB_INTERVALS for i in range(SUB_INTERVALS)]

RATE_ROWS: FloatArray = np.concatenate([bernstein_rows(jacobi(t), _NODES) for t in _PLACES])
"""(40, 10): times the coefficients of rho gives the Bernstein coefficients of p = rho / (t (1 - t))."""

TURN_ROWS: dict[tuple[bool, bool], FloatArray] = {
    (a, b): np.concatenate([bernstein_rows(profile_rate(t, a, b), _NODES) for t in _PLACES])
    for a in (False, True)
    for b in (False, True)
}
"""(40,) Bernstein coefficients of q = S' / (t (1 - t)) for every pair of end conditions (joint before, joint after)."""


def curvature_bound(coefficients: FloatArray, turn: float, joints: tuple[bool, bool]) -> float:
    """An upper bound of |dtheta/ds| over the whole piece [rad/m]; infinite where rho is not proved positive.

    Where every Bernstein coefficient of |q| is at most r times that of p > 0, |q| <= r p holds between them too.
    """
    p = RATE_ROWS @ coefficients
    if float(p.min()) <= 0.0:
        return float("inf")
    return float(np.max(np.abs(turn) * TURN_ROWS[joints] / p, initial=0.0))
