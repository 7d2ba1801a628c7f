"""Small quadratic programmes, solved exactly by DAQP (Arnstrom et al. 2022), a dual active-set method."""

from typing import NamedTuple

import daqp
import numpy as np

from vsx_ros.arrays import FloatArray

_ITERATIONS = 1000


class QpProblem(NamedTuple):
    """Minimise 1/2 x'P x + q'x subject to lower <= A x <= upper.

    P (n, n) symmetric positive definite, q (n,), A (m, n), lower and upper (m,), infinite where there is no bound.
    """

    P: FloatArray
    q: FloatArray
    A: FloatArray
    lower: FloatArray
    upper: FloatArray


class QpSolution(NamedTuple):
    """x (n,), and duals (m,) of the rows."""

    x: FloatArray
    duals: FloatArray


def solve_qp(problem: QpProblem, duals: FloatArray | None = None) -> QpSolution | None:
    """The solution, or None when DAQP reports none (infeasible, or the iteration limit).

    duals (m,): those of a similar problem, from whose active rows the search begins; the solution is the same.
    """
    sense = np.where(problem.lower == problem.upper, 5, 0).astype(np.int32)
    x, _, flag, info = daqp.solve(
        problem.P, problem.q, np.ascontiguousarray(problem.A), np.minimum(problem.upper, 1e30),
        np.maximum(problem.lower, -1e30), sense, primal_tol=1e-9, iter_limit=_ITERATIONS, dual_start=duals,
    )  # fmt: skip
    x = np.array(x, float)
    return QpSolution(x, np.array(info["lam"], float)) if flag >= 1 and np.all(np.isfinite(x)) else None
