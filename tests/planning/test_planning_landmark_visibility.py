"""The camera's view along a path, and the planner's preference for keeping it."""

import math

import numpy as np
import pytest

from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.planning.corridor import Visibility
from vsx_ros.planning.joint_qp import connections
from vsx_ros.planning.path import Plan, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import arc_piece, turn_piece
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.slow_spans import blind_spans
from vsx_ros.planning.time_scaling import time_scale

OPEN = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, -4.0, -4.0)


def wall_ahead(n: int = 400) -> np.ndarray:
    """Landmarks on the wall x = 3.5."""
    rng = np.random.default_rng(0)
    return np.stack([np.full(n, 3.5), rng.uniform(-3.0, 3.0, n), rng.uniform(0.0, 1.0, n)], axis=1)


def visibility(landmarks: np.ndarray) -> Visibility:
    return Visibility(landmarks, PlannerConfig(sight_fov_rad=1.05, sight_range_m=4.5, sight_landmarks=30))


def test_poses_that_look_away_or_at_an_edge_are_blind():
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi], [0.0, 2.9, 0.6], [-3.0, 0.0, 0.0]])
    assert visibility(wall_ahead()).blind(poses, OPEN).tolist() == [False, True, True, True]
    assert visibility(np.zeros((0, 3))).blind(poses, OPEN).all()


def test_a_wall_between_hides_the_landmarks():
    data = np.array(OPEN.data)
    data[:, 120] = OCCUPIED
    hidden = OccupancyGrid(data, 0.05, -4.0, -4.0)
    assert visibility(wall_ahead()).blind(np.array([[0.0, 0.0, 0.0]]), hidden).all()


def test_only_the_way_driven_blind_is_counted():
    start = SE2(-0.5, 0.0, 0.0)
    ahead = arc_piece(start, 0.0, 1.0, 1)
    about = turn_piece(ahead.end, math.pi)
    back = arc_piece(about.end, 0.0, 0.7, 1)
    path = certified(start, back.end, (ahead, about, back), "by hand")
    assert visibility(wall_ahead()).blind_m(path, OPEN) == pytest.approx(0.7, abs=1e-9)
    assert visibility(wall_ahead()).blind_spans(path, OPEN) == pytest.approx(np.array([[1.0, 1.7]]), abs=1e-9)
    assert visibility(np.zeros((0, 3))).blind_spans(path, OPEN) == pytest.approx(np.array([[0.0, 1.7]]), abs=1e-9)


def blind_m_of(plan: Plan) -> float:
    assert plan.blind_spans is not None
    return float(np.sum(np.diff(plan.blind_spans)))


def test_a_path_that_keeps_the_map_in_view_is_preferred():
    planner = Planner(PlannerConfig(phi_rad_m=1.0, max_blind_m=20.0), RobotConfig())
    rng = np.random.default_rng(0)
    better = 0
    for _ in range(30):
        start = SE2(rng.uniform(-1.0, 1.0), rng.uniform(-1.5, 1.5), rng.uniform(-0.5, 0.5))
        goal = SE2(rng.uniform(-1.0, 1.0), rng.uniform(-1.5, 1.5), rng.uniform(-0.5, 0.5))
        view = visibility(wall_ahead())
        plain = planner.plan(start, goal, OPEN, np.random.default_rng(0))
        seeing = planner.plan(start, goal, OPEN, np.random.default_rng(0), view)
        assert isinstance(plain, Plan)
        assert isinstance(seeing, Plan)
        assert plain.blind_spans is None
        without = view.blind_m(plain.path, OPEN)
        assert blind_m_of(seeing) <= without + 1e-9
        assert seeing.path.certificate.end_error_m <= 1e-9
        better += blind_m_of(seeing) < without - 0.1
    assert better >= 3


@pytest.mark.parametrize(("goal_x_m", "blind_m"), [(-1.0, [0.57, 1.08]), (1.0, [0.1, 0.0])])
def test_of_two_ways_equally_long_the_one_that_keeps_the_map_in_view_is_taken(goal_x_m, blind_m):
    """Forwards first or backwards first; without the view it is always forwards."""
    planner, view = Planner(PlannerConfig(phi_rad_m=1.0, max_blind_m=20.0), RobotConfig()), visibility(wall_ahead())
    start, goal = SE2(0.0, 0.0, 0.0), SE2(goal_x_m, 0.5, 0.0)
    ways = connections(start, goal, 1.0, enough=4)[:2]
    assert [view.blind_m(way, OPEN) for way in ways] == pytest.approx(blind_m, abs=0.04)
    plain = planner.plan(start, goal, OPEN, np.random.default_rng(0))
    seeing = planner.plan(start, goal, OPEN, np.random.default_rng(0), view)
    assert isinstance(plain, Plan)
    assert isinstance(seeing, Plan)
    assert seeing.path.length_m == pytest.approx(plain.path.length_m, abs=1e-3)
    assert view.blind_m(plain.path, OPEN) == pytest.approx(blind_m[0], abs=0.04)
    assert blind_m_of(seeing) == pytest.approx(min(blind_m), abs=0.04)


def test_driving_long_without_the_map_is_refused_and_a_little_of_it_is_slow():
    config = PlannerConfig(sight_fov_rad=1.05, sight_landmarks=30, max_blind_m=0.5)
    start, goal = SE2(0.0, 0.0, 0.0), SE2(-2.0, 0.0, 3.0)
    refusal = Planner(config, RobotConfig()).plan(
        start, goal, OPEN, np.random.default_rng(0), Visibility(wall_ahead(), config)
    )
    assert isinstance(refusal, Refusal)
    assert refusal.kind is RefusalKind.BLIND
    assert "limit 0.5 m" in refusal.reason
    config = PlannerConfig(sight_fov_rad=1.05, sight_landmarks=30, max_blind_m=9.0)
    plan = Planner(config, RobotConfig()).plan(
        start, goal, OPEN, np.random.default_rng(0), Visibility(wall_ahead(), config)
    )
    assert isinstance(plan, Plan)
    assert plan.blind_spans is not None
    assert 0.5 < np.sum(np.diff(plan.blind_spans)) < plan.path.length_m
    trajectory = time_scale(plan.path, LimitsConfig(), blind_spans(plan.blind_spans, 0.12))
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T))])
    inside = np.any((s[:, None] > plan.blind_spans[:, 0] + 0.01) & (s[:, None] < plan.blind_spans[:, 1] - 0.01), axis=1)
    assert 0.1 < np.abs(trajectory.v[inside]).max() <= 0.12 + 1e-9
    assert np.abs(trajectory.v[~inside]).max() > 0.2


def test_where_the_best_way_is_driven_blind_for_too_long_another_one_is_taken():
    planner, view = Planner(PlannerConfig(phi_rad_m=1.0, max_blind_m=0.6), RobotConfig()), visibility(wall_ahead())
    patient = Planner(PlannerConfig(phi_rad_m=1.0, max_blind_m=20.0), RobotConfig())
    start, goal = SE2(0.94, 0.82, 0.87), SE2(0.52, 0.29, 1.25)
    best = patient.plan(start, goal, OPEN, np.random.default_rng(0), view)
    other = planner.plan(start, goal, OPEN, np.random.default_rng(0), view)
    assert isinstance(best, Plan)
    assert isinstance(other, Plan)
    assert np.diff(best.blind_spans).max() > 0.6 > np.diff(other.blind_spans).max()
    assert other.path.length_m > best.path.length_m


def test_a_narrow_way_in_view_of_the_map_is_taken_where_the_wide_one_is_driven_blind_for_too_long():
    """A wall with a narrow door, before which the landmarks are seen, and a wide one far from them."""
    data = np.zeros((110, 170), np.int8)
    data[:2], data[-2:], data[:, :2], data[:, -2:], data[:, 82:85] = (OCCUPIED,) * 5
    data[20:31, 82:85] = data[68:92, 82:85] = 0
    rng = np.random.default_rng(0)
    south = np.column_stack([rng.uniform(0.3, 8.2, 300), np.full(300, 0.12), np.full(300, 0.5)])
    east = np.column_stack([np.full(150, 8.38), rng.uniform(0.2, 2.0, 150), np.full(150, 0.5)])
    config = PlannerConfig(sight_fov_rad=1.05)
    planner, view = Planner(config, RobotConfig()), Visibility(np.vstack([south, east]), config)
    start, goal = SE2(2.21, 2.16, 0.29), SE2(7.0, 1.54, 0.27)
    plan = planner.plan(start, goal, OccupancyGrid(data, 0.05, 0.0, 0.0), np.random.default_rng(0), view)
    assert isinstance(plan, Plan), plan
    assert np.diff(plan.blind_spans).max() <= config.max_blind_m


def test_landmarks_that_are_not_finite_are_an_error():
    with pytest.raises(PlanningError, match="landmark"):
        visibility(np.full((1, 3), np.nan))
