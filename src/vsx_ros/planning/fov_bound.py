"""The bound on the change of view, |dtheta/ds| <= phi (paper eq. 5, 6, 11), made linear and certain.

In (theta, rho) form eq. (5) reads |thetadot| <= phi rho. Both sides share ``rest_factor``; what remains,
phi p(t) - |q(t)| >= floor, is a polynomial of degree 9 that is linear in the coefficients of rho. Its Bernstein
coefficients on sub-intervals being non-negative proves it for every t, not only on a grid.
"""

from math import comb

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.planning.flat_output import COEFFICIENTS, FLAGS, JOINT_SLOPE, jacobi, profile_rate

SUB_INTERVALS = 4

JOINT_RAMP = 8.0
"""Per metre: through a joint the curvature goes from none to phi in an eighth of a metre at the fastest."""


def bernstein_rows(values_at: FloatArray, nodes: FloatArray) -> FloatArray:
    """(10, ...) Bernstein coefficients of degree 9 of polynomials with values (10, ...) at nodes (10,) in [0, 1]."""
    degree = COEFFICIENTS - 1
    vandermonde = np.stack(
        [comb(degree, j) * nodes**j * (1.0 - nodes) ** (degree - j) for j in range(COEFFICIENTS)], axis=1
    )
    return np.asarray(np.linalg.solve(vandermonde, values_at), np.float64)


_NODES: FloatArray = 0.5 - 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
_PLACES = [(i + _NODES) / SUB_INTERVALS for i in range(SUB_INTERVALS)]

RATE_ROWS: FloatArray = np.concatenate([bernstein_rows(jacobi(t), _NODES) for t in _PLACES])
"""(40, 10): times the coefficients of rho gives the Bernstein coefficients of p = rho / rest_factor."""

TURN_ROWS: dict[tuple[bool, bool], FloatArray] = {
    flags: np.concatenate([bernstein_rows(profile_rate(t, *flags), _NODES) for t in _PLACES]) for flags in FLAGS
}
"""(40,) Bernstein coefficients of q = S' / rest_factor for every pair of end conditions (joint before, joint after)."""


def least_rate(turn: float, phi: float, joints: tuple[bool, bool], floor: float) -> FloatArray:
    """(40,) what ``RATE_ROWS`` times the coefficients must reach, so that |dtheta/ds| <= phi with a little room.

    At a joint p also has to be so large that the curvature does not change faster than ``JOINT_RAMP`` phi per metre.
    """
    least: FloatArray = abs(turn) / phi * TURN_ROWS[joints] + floor
    ramp = np.sqrt(JOINT_SLOPE * abs(turn) / (JOINT_RAMP * phi))
    for row, joint in ((0, joints[0]), (-1, joints[1])):
        if joint:
            least[row] = max(float(least[row]), float(ramp))
    return least


def curvature_bound(coefficients: FloatArray, turn: float, joints: tuple[bool, bool]) -> float:
    """An upper bound of |dtheta/ds| over the whole piece [rad/m]; infinite where rho is not proved positive.

    Where every Bernstein coefficient of |q| is at most r times that of p > 0, |q| <= r p holds between them too.
    """
    p = RATE_ROWS @ coefficients
    if float(p.min()) <= 0.0:
        return float("inf")
    return float(np.max(np.abs(turn) * TURN_ROWS[joints] / p, initial=0.0))
