"""The paper's method: its equations hold, its basis is well conditioned, and it says no before it solves anything."""

import math

import numpy as np
import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning import two_level_qp
from vsx_ros.planning.flat_output import profile
from vsx_ros.planning.path import Path, Refusal, RefusalKind
from vsx_ros.planning.two_level_qp import build, connect_paper, feasible

REACHED = SE2(2.2, 1.8, math.pi / 2)
ZETA_F = math.tan(math.pi / 4)


def test_level_one_is_the_minimiser_of_its_programme():
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    rates = np.concatenate([t**2 / 2 - t**3 / 3, t**3 / 3 - t**4 / 4, t**4 / 4 - t**5 / 5], axis=1)  # of t^k - t^(k+1)
    steps = np.diff(rates, axis=0)
    kkt = np.block([[steps.T @ steps, rates[-1:].T], [rates[-1:], np.zeros((1, 1))]])
    b = np.linalg.solve(kkt, np.eye(4)[3])[:3]  # of (7)-(8) on a fine grid, zetadot zero at both ends by the basis
    assert profile(t.ravel(), False, False) == pytest.approx(rates @ b, abs=1e-5)


def test_level_two_is_well_conditioned_where_monomials_are_not():
    problem = build(ZETA_F, 2.5, 0.0, 1.0)
    free = np.linalg.svd(problem.A[:2])[2][2:].T
    assert np.linalg.cond(free.T @ problem.P @ free) < 100.0
    t = np.linspace(0.0, 1.0, 52)[:, None]
    steps = np.diff(t ** np.arange(3, 13), axis=0)
    assert np.linalg.cond(steps.T @ steps) > 1e9


def test_what_the_closed_form_excludes_is_never_solved(monkeypatch):
    def unexpected(*_):
        raise AssertionError("solved although out of reach")

    monkeypatch.setattr(two_level_qp, "solve_qp", unexpected)
    for goal in (SE2(2.0, 0.5, 0.0), SE2(0.9, 1.8, math.pi / 2), SE2(0.0, 1.0, 0.0)):
        refusal = connect_paper(SE2(), goal, 1.0)
        assert isinstance(refusal, Refusal)
        assert refusal.kind is RefusalKind.INFEASIBLE
        assert "forwards" in refusal.reason
        assert "in reverse" in refusal.reason
        margin = feasible(SE2(), goal, 1.0).margin_m
        assert margin < 0.0
        assert f"{-margin:.3f} m" in refusal.reason
    with pytest.raises(AssertionError, match="out of reach"):
        connect_paper(SE2(), REACHED, 1.0)


@pytest.mark.parametrize("start", [SE2(), SE2(3.0, -2.0, 2.5)])
def test_the_reported_violation_is_the_largest_one(start):
    path = connect_paper(start, start @ REACHED, 1.0)
    assert isinstance(path, Path)
    dense = np.abs(path.sample(0.001)[:, 3]).max()
    assert path.certificate.curvature_bound_rad_m == pytest.approx(dense, rel=1e-3)
    assert "dense samples" in path.certificate.method
    assert path.certificate.end_error_m <= 1e-9


def test_a_solver_that_fails_is_no_solution(monkeypatch):
    monkeypatch.setattr(two_level_qp, "solve_qp", lambda problem: None)
    refusal = connect_paper(SE2(), REACHED, 1.0)
    assert isinstance(refusal, Refusal)
    assert refusal.kind is RefusalKind.INFEASIBLE
    assert "no polynomials" in refusal.reason
    assert "rad/m" in refusal.reason


def test_a_solution_that_turns_too_fast_is_none(monkeypatch):
    real = two_level_qp.solve_qp

    def wrong(problem):
        return real(problem)._replace(x=np.where(np.arange(10) == 5, 50.0, 0.0))

    monkeypatch.setattr(two_level_qp, "solve_qp", wrong)
    refusal = connect_paper(SE2(), REACHED, 1.0)
    assert isinstance(refusal, Refusal)
    assert refusal.kind is RefusalKind.INFEASIBLE
    assert "the curve turns at" in refusal.reason
    assert "rad/m" in refusal.reason
