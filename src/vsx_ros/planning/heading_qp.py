"""Level one of the paper's optimisation: the coefficients b of zeta(t) = tan(theta(t)) (paper 4.2)."""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.planning.flat_output import COARSE, FINE, jacobi
from vsx_ros.planning.qp import QpProblem, solve_osqp

HEADING_COEFFICIENTS = 3
"""zeta of degree 5 with zetadot zero at both ends leaves three (paper eq. 2, 4)."""


def zeta_rows(t: FloatArray) -> FloatArray:
    """(N, 3) rows that give zeta(t) - zeta(t_0): the integral of t (1 - t) P_k from 0 to t, exactly."""
    nodes, weights = np.polynomial.legendre.leggauss(3)  # exact to degree 5; zetadot has 4
    inner = 0.5 * np.asarray(t, float)[:, None] * (nodes + 1.0)
    rates = (inner * (1.0 - inner)).ravel()[:, None] * jacobi(inner.ravel())[:, :HEADING_COEFFICIENTS]
    summed = np.einsum("j,ijk->ik", weights, rates.reshape(len(t), 3, HEADING_COEFFICIENTS))
    return np.asarray(0.5 * np.asarray(t, float)[:, None] * summed)


def grid(n: int) -> IntArray:
    """(n + 2,) indices of the knots of ``FINE`` nearest to an even grid t_0, t_1 .. t_n, t_f."""
    return np.round(np.linspace(0, len(FINE.knots) - 1, n + 2)).astype(np.int64)


ZETA_KNOTS = zeta_rows(FINE.knots)
ZETA_FINE = zeta_rows(FINE.t)
ZETA_COARSE = zeta_rows(COARSE.t)


def solve_heading(zeta_0: float, zeta_f: float, n: int) -> FloatArray:
    """b (3,) that minimises (7) subject to (8) on n + 2 grid points.

    (7)  min sum_i (zeta(t_i+1) - zeta(t_i))^2
    (8)  zeta(t_0) = zeta_0, zeta(t_f) = zeta_f, zetadot(t_0) = zetadot(t_f) = 0      (the last two by the basis)
    """
    steps = np.diff(ZETA_KNOTS[grid(n)], axis=0)
    end, change = ZETA_KNOTS[-1:], np.array([zeta_f - zeta_0])
    problem = QpProblem(P=2.0 * steps.T @ steps, q=np.zeros(HEADING_COEFFICIENTS), A=end, lower=change, upper=change)
    b = solve_osqp(problem).x
    exact: FloatArray = b + np.linalg.lstsq(end, change - end @ b, rcond=None)[0]
    return exact
