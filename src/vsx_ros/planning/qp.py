"""Quadratic programmes and the two solvers behind them; every answer is measured here, not believed.

OSQP (Stellato et al. 2020) serves the paper's own formulation; DAQP (Arnstrom et al. 2022), an exact dual active-set
method, the small nearly linear programmes of the certified one.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from dataclasses import dataclass

import daqp
import numpy as np
import osqp
from scipy import sparse

from vsx_ros.arrays import FloatArray

_ITERATIONS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class QpProblem:
    """Minimise 1/2 x'P x + q'x subject to lower <= A x <= upper.

    P (n, n) symmetric positive definite, q (n,), A (m, n), lower and upper (m,), infinite where there is no bound.
    """

    P: FloatArray
    q: FloatArray
    A: FloatArray
    lower: FloatArray
    upper: FloatArray

    def violation(self, x: FloatArray) -> float:
        """The largest amount by which a row of the constraints is missed."""
        value = self.A @ x
        return float(np.max(np.maximum(self.lower - value, value - self.upper), initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class QpSolution:
    """x (n,) and what it really violates; ``word`` is what the solver said; duals (m,) of the rows, where it tells."""

    x: FloatArray
    violation: float
    word: str
    duals: FloatArray | None = None


def solve_exact(problem: QpProblem, duals: FloatArray | None = None) -> QpSolution | None:
    """DAQP's solution, or None when it reports none (infeasible, or the iteration limit).

    duals (m,): those of a similar problem, from whose active rows the search begins; the solution is the same.
    """
    sense = np.where(problem.lower == problem.upper, 5, 0).astype(np.int32)
    x, _, flag, info = daqp.solve(
        problem.P,
        problem.q,
        np.ascontiguousarray(problem.A),
        np.minimum(problem.upper, 1e30),
        np.maximum(problem.lower, -1e30),
        sense,
        primal_tol=1e-9,
        iter_limit=_ITERATIONS,
        dual_start=duals,
    )
    x = np.array(x, float)
    if flag < 1 or not np.all(np.isfinite(x)):
        return None
    return QpSolution(x, problem.violation(x), f"optimal ({flag})", np.array(info["lam"], float))


def solve_osqp(problem: QpProblem) -> QpSolution:
    """OSQP's last iterate with its verdict, polished; settings that do not depend on the time it takes."""
    solver = osqp.OSQP()
    # It prints about polishing even when told to be quiet.
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solver.setup(
            sparse.csc_matrix(np.triu(problem.P)),
            problem.q,
            sparse.csc_matrix(problem.A),
            problem.lower,
            problem.upper,
            verbose=False,
            eps_abs=1e-5,
            eps_rel=1e-5,
            max_iter=4000,
            polishing=True,
            adaptive_rho=1,
            adaptive_rho_interval=50,
        )
        result = solver.solve(raise_error=False)
    x = np.array(result.x, float)
    if x.shape != problem.q.shape or not np.all(np.isfinite(x)):
        x = np.zeros(len(problem.q))
    return QpSolution(x, problem.violation(x), str(result.info.status))
