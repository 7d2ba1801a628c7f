"""Connections end exactly on the goal and keep the bound, by an integration of the motion that knows nothing else."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.planning.coarse_path import shortest_word
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Refusal, RefusalKind
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.two_level_qp import connect_paper, feasible

poses = st.builds(SE2, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-math.pi, math.pi))
bounds = st.sampled_from([0.5, 1.0, 2.0])


def driven(path: Path) -> SE2:
    """Where a unicycle ends that drives the path's curvature over its arc length (midpoint rule, 1 mm)."""
    x, y, theta = path.start.x, path.start.y, path.start.theta
    for piece in path.pieces:
        n = max(100, math.ceil(piece.length_m / 0.001))
        h = piece.length_m / n
        kappa = piece.at((np.arange(n) + 0.5) * h)[:, 3]
        headings = theta + np.concatenate([[0.0], np.cumsum(kappa * h)])
        middle = 0.5 * (headings[1:] + headings[:-1])
        x += piece.direction * float(np.cos(middle).sum()) * h
        y += piece.direction * float(np.sin(middle).sum()) * h
        theta = float(headings[-1])
    return SE2(x, y, theta)


@given(poses, poses, bounds)
@example(SE2(), SE2(0.0, 1.0, 0.0), 1.0)  # pure lateral offset
@example(SE2(), SE2(0.0, 0.0, math.pi), 1.0)  # turn round where one stands
@example(SE2(), SE2(-2.0, 0.0, 0.0), 1.0)  # straight behind
@example(SE2(), SE2(3.0, 0.0, 0.0), 1.0)  # straight ahead
@example(SE2(), SE2(0.001, 0.0, 0.0), 1.0)
@example(SE2(), SE2(0.0, 1e-4, 1e-4), 1.0)
@example(SE2(0.0, 0.0, 50.0), SE2(1.0, 1.0, -50.0), 1.0)  # unwrapped headings
@example(SE2(-2.0, -4.0, 0.0), SE2(2.0, 3.0, -1.0), 2.0)  # 2.07 mm after 8 m
@settings(max_examples=150)
def test_a_connection_is_exact_and_keeps_the_bound(start, goal, phi):
    path = connect(start, goal, phi)
    assert isinstance(path, Path)
    assert path.end.distance_to(goal) <= 1e-9
    assert abs(wrap_angle(path.end.theta - goal.theta)) <= 1e-9
    assert path.certificate.curvature_bound_rad_m <= phi * (1.0 + 1e-9)
    rows = path.sample(0.002)
    assert np.abs(rows[:, 3]).max() <= phi * (1.0 + 1e-6)
    arrived = driven(path)
    assert arrived.distance_to(goal) < max(2e-3, 3e-4 * path.length_m)  # curvature is read linearly from a table
    assert abs(wrap_angle(arrived.theta - goal.theta)) < 2e-3


@given(poses, bounds)
@settings(max_examples=150)
def test_length_is_near_the_shortest_possible(goal, phi):
    assume(abs(goal.x) + abs(goal.y) + abs(goal.theta) > 1e-6)
    path = connect(SE2(), goal, phi)
    assert isinstance(path, Path)
    shortest = shortest_word(SE2(), goal, phi).length_m
    assert path.length_m >= shortest - 1e-5  # its inverse cosines lose half the digits next to the start
    assert path.length_m <= 1.6 * shortest + 0.7  # a stop for a jump of curvature is worth a small detour


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("bend", [1, -1])
@pytest.mark.parametrize("theta", [0.0, 2.0])
def test_an_arc_obeys_the_unicycle(direction, bend, theta):
    start = SE2(0.3, -0.2, theta)
    piece = arc_piece(start, 0.8 * bend, 1.5, direction)
    path = Path(start, (piece,), None)  # type: ignore[arg-type]  # nobody asks for its certificate
    end = driven(path)
    assert end.distance_to(piece.end) < 1e-6
    assert end.theta == pytest.approx(piece.end.theta, abs=1e-12)
    # kappa counts arc length positive both ways: a left-hand bend has omega > 0 also in reverse.
    assert piece.turn_rad == pytest.approx(1.2 * bend)


def test_no_way_from_a_pose_to_itself():
    path = connect(SE2(1.0, 2.0, 3.0), SE2(1.0, 2.0, 3.0 - 2.0 * math.pi), 1.0)
    assert isinstance(path, Path)
    assert path.length_m == 0.0
    assert path.sample(0.1).shape == (1, 5)


@pytest.mark.parametrize("phi", [0.0, -1.0, math.nan, math.inf])
def test_a_bound_without_meaning_is_refused(phi):
    with pytest.raises(PlanningError, match="phi"):
        connect(SE2(), SE2(1.0, 0.0, 0.0), phi)


def test_a_pose_without_meaning_is_refused():
    with pytest.raises(PlanningError, match="goal pose"):
        connect(SE2(), SE2(1.0, math.nan, 0.0), 1.0)


def test_the_same_question_has_the_same_bits():
    first, second = (connect(SE2(), SE2(1.3, -0.8, 2.0), 1.0) for _ in range(2))
    assert isinstance(first, Path)
    assert isinstance(second, Path)
    assert first.sample(0.01).tobytes() == second.sample(0.01).tobytes()


def test_curvature_runs_smoothly_except_at_cusps():
    path = connect(SE2(), SE2(2.0, 1.5, 0.0), 1.0)
    assert isinstance(path, Path)
    assert len(path.stretches()) == len(path.cusps) + 1


SIGNS = [(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)]


@pytest.mark.parametrize(("ahead", "left", "turn"), SIGNS)
@pytest.mark.parametrize("phi", [0.5, 2.0])
def test_every_combination_of_signs_is_a_mirror_image(ahead, left, turn, phi):
    path = connect(SE2(), SE2(ahead * 1.4, left * 0.8, turn * 1.1), phi)
    # Mirroring left and right and driving the other way round are symmetries of the question.
    side = connect(SE2(), SE2(ahead * 1.4, -left * 0.8, -turn * 1.1), phi)
    back = connect(SE2(), SE2(-ahead * 1.4, left * 0.8, -turn * 1.1), phi)
    assert isinstance(path, Path)
    assert isinstance(side, Path)
    assert isinstance(back, Path)
    assert side.length_m == pytest.approx(path.length_m, rel=1e-6)
    assert back.length_m == pytest.approx(path.length_m, rel=1e-6)
    assert back.reverse_m == pytest.approx(path.length_m - path.reverse_m, abs=1e-5)
    assert driven(path).distance_to(path.end) < 2e-3


@pytest.mark.parametrize("offset", [-1e-9, 0.0, 1e-9])
@pytest.mark.parametrize("heading", [0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi])
def test_headings_where_formulas_divide_by_nothing(heading, offset):
    for goal in (SE2(1.0, 0.0, heading + offset), SE2(0.0, 1.0, heading + offset), SE2(-1.5, 0.0, heading + offset)):
        path = connect(SE2(), goal, 1.0)
        assert isinstance(path, Path)
        assert path.certificate.end_error_m <= 1e-9
        assert path.certificate.end_error_rad <= 1e-9
        assert path.certificate.curvature_bound_rad_m <= 1.0 + 1e-9


@given(poses, st.sampled_from([1e-2, 1e2, 1e3]))
@settings(max_examples=40)
def test_absurd_bounds_are_kept_too(goal, phi):
    path = connect(SE2(), goal, phi)
    assert isinstance(path, Path)
    assert path.certificate.curvature_bound_rad_m <= phi * (1.0 + 1e-9)
    assert path.certificate.end_error_m <= 1e-6 / min(phi, 1.0)


@given(poses, bounds)
@example(SE2(3.0, 4.0, 3.0), 2.0)  # 12 m long, with its samples 13 cm apart
@settings(max_examples=60)
def test_paper_mode_reports_its_own_violation(goal, phi):
    path = connect_paper(SE2(), goal, phi)
    reachable = feasible(SE2(), goal, phi).ok or feasible(SE2(), goal, phi, reverse=True).ok
    if isinstance(path, Refusal):
        assert path.kind is RefusalKind.INFEASIBLE
        assert path.reason
        return
    assert reachable
    assert len(path.cusps) == 0
    assert path.end.distance_to(goal) <= 1e-9
    assert path.certificate.curvature_bound_rad_m <= phi * 1.001
    assert driven(path).distance_to(goal) < 2e-3 + 5e-4 * path.length_m


@pytest.mark.parametrize(
    ("goal", "reverse", "ok"),
    [
        (SE2(2.2, 1.8, math.pi / 2), False, True),
        (SE2(0.9, 1.8, math.pi / 2), False, False),  # too near for the bend
        (SE2(2.0, 0.5, 0.0), False, False),  # a lane change has no monotone heading
        (SE2(2.0, 0.0, 0.0), False, True),
        (SE2(-2.0, 0.0, 0.0), True, True),
        (SE2(-2.2, 1.8, -math.pi / 2), True, True),
        (SE2(0.0, 2.5, math.pi), False, True),
    ],
)
def test_the_closed_form_of_what_one_segment_reaches(goal, reverse, ok):
    verdict = feasible(SE2(), goal, 1.0, reverse)
    assert verdict.ok == ok
    assert verdict.reason
    assert (verdict.margin_m >= -1e-9) == ok


def test_the_paper_solves_most_of_what_it_can_reach():
    rng = np.random.default_rng(3)
    solved = possible = 0
    while possible < 30:
        goal = SE2(*rng.uniform(-3.0, 3.0, 3))
        if feasible(SE2(), goal, 1.0).ok:
            possible += 1
            solved += isinstance(connect_paper(SE2(), goal, 1.0), Path)
    assert 20 <= solved <= 30
