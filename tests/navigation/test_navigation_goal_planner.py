"""Which goals the robot plans to, and in what: a goal on the map is never driven to blindly."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config, PlannerConfig, RobotConfig
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Plan, Refusal, TimedPlan
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import PLANNERS

START, GOAL = SE2(1.0, 1.5, 0.0), SE2(2.0, 1.5, 0.0)


def room(*, walled: bool = False) -> OccupancyGrid:
    data = np.zeros((60, 60), np.int8)
    if walled:
        data[:, 30] = OCCUPIED
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


@pytest.fixture(params=["fov", "unconstrained"])
def plans(request: pytest.FixtureRequest) -> GoalPlanner:
    return GoalPlanner(Config(), request.param, 1)


def refused(plan: Plan | Refusal) -> str:
    assert isinstance(plan, Refusal)
    return plan.reason


def test_a_goal_on_the_map_waits_for_a_map_and_one_by_the_wheels_does_not(plans: GoalPlanner) -> None:
    assert "no map yet" in refused(plans.plan(START, GOAL, "map"))
    assert isinstance(plans.plan(START, GOAL, "odom"), Plan)
    plans.take_grid(room(), 1)
    assert isinstance(plans.plan(START, GOAL, "map"), Plan)


def test_a_wall_is_in_the_way_on_the_map_only(plans: GoalPlanner) -> None:
    plans.take_grid(room(walled=True), 1)
    assert refused(plans.plan(START, GOAL, "map"))
    assert isinstance(plans.plan(START, GOAL, "odom"), Plan)


@pytest.mark.parametrize("frame", ["", "base_footprint", "robot2/map"])
def test_a_frame_that_is_neither_map_nor_odom_is_refused(plans: GoalPlanner, frame: str) -> None:
    plans.take_grid(room(), 1)
    assert repr(frame) in refused(plans.plan(START, GOAL, frame))


def test_a_planner_of_another_name_is_named() -> None:
    with pytest.raises(ConfigError, match="no planner named 'dwa'; give one of fov, unconstrained"):
        GoalPlanner(Config(), "dwa", 1)


def test_a_goal_that_is_nowhere_is_refused_with_its_name(plans: GoalPlanner) -> None:
    plans.take_grid(room(), 1)
    answer = plans.timed(START, SE2(math.nan, 0.0, 0.0), "map")
    assert isinstance(answer, Refusal)
    assert "goal pose (nan" in answer.reason


def top_speed(plan: TimedPlan | Refusal) -> float:
    assert isinstance(plan, TimedPlan)
    return float(np.abs(plan.trajectory.v).max())


@pytest.mark.parametrize("way_m", [0.45, -0.45])
def test_before_there_is_a_map_it_drives_so_slowly_that_it_may_touch(plans: GoalPlanner, way_m: float) -> None:
    goal = START @ SE2(way_m, 0.0, 0.0)
    slow = Config().planner.unmapped_v_m_s
    assert top_speed(plans.timed(START, goal, "odom")) == pytest.approx(slow, rel=1e-3)
    plans.take_grid(room(), 1)  # the ground under the robot is known from the beginning
    assert top_speed(plans.timed(START, goal, "odom")) == pytest.approx(slow, rel=1e-3)
    plans.take_landmarks(np.ones((30, 3)), 1)
    assert top_speed(plans.timed(START, goal, "odom")) > 2 * slow


def test_before_there_is_a_map_it_turns_on_the_spot(plans: GoalPlanner) -> None:
    turn = plans.timed(START, START @ SE2(0.0, 0.0, 0.5 * math.pi), "odom")
    assert isinstance(turn, TimedPlan)
    assert turn.trajectory.poses[-1, 2] == pytest.approx(0.5 * math.pi)
    assert not turn.trajectory.v.any()


def test_a_planner_of_a_user_hears_the_field_of_view(monkeypatch: pytest.MonkeyPatch) -> None:
    heard_rad = list[float]()

    def mine(config: PlannerConfig, robot: RobotConfig) -> Planner:
        heard_rad.append(config.sight_fov_rad)
        return Planner(config, robot)

    monkeypatch.setitem(PLANNERS, "mine", mine)
    GoalPlanner(Config(), "mine", 1).look_with(0.8)
    assert heard_rad == [pytest.approx(1.05, abs=0.01), 0.8]
