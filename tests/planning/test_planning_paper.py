"""The paper's method: its equations hold, its basis is well conditioned, and it says no before it solves anything."""

import math

import numpy as np
import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning import heading_qp, position_qp
from vsx_ros.planning.connect import connect
from vsx_ros.planning.feasibility import feasible
from vsx_ros.planning.path import Path, Refusal, RefusalKind
from vsx_ros.planning.position_qp import GRID_POINTS, build, displacement_rows

REACHED = SE2(2.2, 1.8, math.pi / 2)


def level_one() -> position_qp._Heading:
    zeta = math.tan(math.pi / 4)
    return position_qp._Heading(-zeta, heading_qp.solve_heading(-zeta, zeta, GRID_POINTS))


def test_level_one_is_the_known_minimiser():
    t = np.linspace(0.0, 1.0, 101)
    s = 7.5 * t**2 - 20.0 * t**3 + 22.5 * t**4 - 9.0 * t**5  # of (7)-(8) on a fine grid
    zeta = level_one().zeta(heading_qp.zeta_rows(t))
    assert np.abs(zeta - (2.0 * s - 1.0)).max() < 5e-3  # of n = 50, which stops short of it


def test_level_two_is_well_conditioned_where_monomials_are_not():
    problem = build(level_one(), 2.5, 0.0, 1.0, GRID_POINTS)
    rows = displacement_rows(level_one())
    free = np.linalg.svd(rows)[2][2:].T
    assert np.linalg.cond(free.T @ problem.P @ free) < 100.0
    t = np.linspace(0.0, 1.0, GRID_POINTS + 2)[:, None]
    steps = np.diff(t ** np.arange(3, 13), axis=0)
    assert np.linalg.cond(steps.T @ steps) > 1e9


def test_what_the_closed_form_excludes_is_never_solved(monkeypatch):
    def unexpected(*_):
        raise AssertionError("solved although out of reach")

    monkeypatch.setattr(position_qp, "solve_osqp", unexpected)
    monkeypatch.setattr(heading_qp, "solve_osqp", unexpected)
    for goal in (SE2(2.0, 0.5, 0.0), SE2(0.9, 1.8, math.pi / 2), SE2(0.0, 1.0, 0.0)):
        refusal = connect(SE2(), goal, 1.0, mode="paper")
        assert isinstance(refusal, Refusal)
        assert refusal.kind is RefusalKind.INFEASIBLE
        assert "forwards" in refusal.reason
        assert "in reverse" in refusal.reason
        margin = feasible(SE2(), goal, 1.0).margin_m
        assert margin < 0.0
        assert f"{-margin:.3f} m" in refusal.reason
    with pytest.raises(AssertionError, match="out of reach"):
        connect(SE2(), REACHED, 1.0, mode="paper")


@pytest.mark.parametrize("start", [SE2(), SE2(3.0, -2.0, 2.5)])
def test_the_reported_violation_is_the_largest_one(start):
    path = connect(start, start @ REACHED, 1.0, mode="paper")
    assert isinstance(path, Path)
    dense = np.abs(path.sample(0.001)[:, 3]).max()
    assert path.certificate.curvature_bound_rad_m == pytest.approx(dense, rel=1e-3)
    assert "dense samples" in path.certificate.method
    assert path.certificate.end_error_m <= 1e-9


def test_a_solver_that_fails_is_no_solution(monkeypatch):
    real = position_qp.solve_osqp

    def stuck(problem):
        answer = real(problem)
        return type(answer)(np.where(np.arange(10) == 5, 50.0, 0.0), 1.0, "maximum iterations reached")

    monkeypatch.setattr(position_qp, "solve_osqp", stuck)
    refusal = connect(SE2(), REACHED, 1.0, mode="paper")
    assert isinstance(refusal, Refusal)
    assert refusal.kind is RefusalKind.INFEASIBLE
    assert "maximum iterations" in refusal.reason
    assert "rad/m" in refusal.reason
