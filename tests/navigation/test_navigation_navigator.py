"""Plans keep the map in view, are slowed while tracking is dubious, and made again where the base strayed; planning
takes its time, and what comes to light on the way is never touched."""

from dataclasses import replace

import numpy as np
import pytest
from driving import CONFIG, PLAN_MS, LockStep, Scene, lock_step, open_floor, with_post

from vsx_ros.config import Config, FollowerConfig
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.slam.state import TrackingState

AHEAD = SE2(3.5, 0.0, 0.0)
RADIUS_M = CONFIG.robot.radius_m


def speeds(run: LockStep, since_s: float = 0.0) -> np.ndarray:
    rows = np.array(run.base.rows)
    return rows[rows[:, 0] >= since_s, 3]


def test_a_base_pushed_off_its_path_stops_and_plans_again():
    run, goal = LockStep(), SE2(2.5, 0.5, 0.3)
    run.go(goal)
    for _ in range(2):
        run.drive(3.0)
        run.base.pushed(0.2)
    run.drive(60.0)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.base.pose.distance_to(goal) < 0.02
    assert run.navigator.plans == 3


def test_a_base_that_strays_again_and_again_gives_up_with_the_reason():
    run = LockStep(Config(follower=FollowerConfig(replans_after_divergence=1)))
    run.go(SE2(2.5, 0.5, 0.3))
    for _ in range(2):
        run.drive(3.0)
        assert run.navigator.state is NavigationState.ACTIVE
        run.base.pushed(0.2)
    run.drive(3.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert "beside the path" in run.navigator.reason
    assert run.navigator.plans == 2


def before_the_goal(run: LockStep, goal: SE2) -> None:
    run.go(goal)
    while run.base.pose.distance_to(goal) > 0.08:
        run.drive(1.0 / 15.0)


@pytest.mark.parametrize("push", [SE2(0.0, 0.09, 0.0), SE2(0.0, 0.0, 0.2)])
def test_a_base_pushed_just_before_its_goal_plans_again_to_reach_it(push: SE2):
    run, goal = LockStep(), SE2(1.5, 0.0, 0.0)
    before_the_goal(run, goal)
    run.base.pose = run.base.pose @ push
    run.drive(30.0)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.base.pose.distance_to(goal) < 0.02
    assert abs(run.base.pose.angle_to(goal)) < 0.05
    assert run.navigator.plans == 2


def test_a_base_that_comes_to_stand_beside_its_goal_again_and_again_gives_up_with_the_reason():
    run, goal = LockStep(Config(follower=FollowerConfig(replans_after_divergence=0))), SE2(1.5, 0.0, 0.0)
    before_the_goal(run, goal)
    run.base.pushed(0.09)
    run.drive(10.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert "cm" in run.navigator.reason
    assert "too far" in run.navigator.reason


def test_dubious_tracking_is_driven_slowly_and_lost_not_at_all():
    run = LockStep()
    run.go(SE2(3.0, 0.0, 0.0))
    run.drive(4.0)
    assert speeds(run)[-1] == pytest.approx(0.3, abs=0.01)
    run.drive(2.0, TrackingState.DUBIOUS)
    assert speeds(run)[-1] == pytest.approx(0.15, abs=0.01)
    run.drive(2.0, TrackingState.LOST)
    assert speeds(run)[-1] == pytest.approx(0.0, abs=0.001)
    run.drive(30.0)
    assert run.navigator.state is NavigationState.SUCCEEDED


def test_a_way_out_of_sight_of_the_map_is_refused():
    rng = np.random.default_rng(0)
    run = LockStep()
    run.planner.take_landmarks(
        np.stack([np.full(400, 3.5), rng.uniform(-3, 3, 400), rng.uniform(0, 1, 400)], axis=1), 0
    )
    run.go(SE2(-3.0, 0.5, 3.1))
    run.drive(1.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert "landmarks in view" in run.navigator.reason
    run.go(SE2(1.0, 0.3, 0.1))
    run.drive(1.0)
    assert run.navigator.state is NavigationState.ACTIVE


def test_while_a_plan_is_made_the_base_stands():
    run = LockStep()
    run.go(AHEAD)
    run.drive(1e-3 * PLAN_MS)
    assert speeds(run).max() == 0.0
    run.drive(1.0)
    assert speeds(run).max() > 0.1


@pytest.mark.parametrize("ahead_m", [0.3, 0.4, 0.5, 0.7, 1.0, 1.4])
def test_what_comes_to_light_ahead_at_full_speed_is_not_touched_and_driven_around(ahead_m: float):
    """ahead_m: from the middle of the base to the nearest side of a post."""
    run = LockStep()
    run.go(AHEAD)
    run.drive(4.0)
    assert speeds(run)[-1] == pytest.approx(0.3, abs=0.01)
    at_x, at_s = run.base.pose.x, 1e-9 * run.base.now_ns
    grid = with_post(at_x + ahead_m, 0.0)
    half = 0.5 * grid.resolution
    near_x = grid.centres(np.argwhere(grid.data))[:, 0].min() - half
    grid = replace(grid, origin_x=grid.origin_x + at_x + ahead_m - near_x)  # exactly so far ahead
    run.planner.take_grid(grid, run.base.now_ns)
    post = grid.centres(np.argwhere(grid.data))
    run.drive(60.0)
    rows = np.array(run.base.rows)
    rows = rows[rows[:, 0] > at_s]
    places = rows[:, 1:3]
    off = np.maximum(np.abs(places[:, None] - post[None]) - half, 0.0)
    clearance_m = np.hypot(*off.transpose(2, 0, 1)).min(axis=1) - RADIUS_M
    stop = int(np.argmax(rows[:, 3] < 0.005))
    assert clearance_m.min() > 0.02, "the base touches it"
    if ahead_m >= 0.5:
        assert clearance_m[: stop + 1].min() >= 0.1
    assert run.navigator.plans == 2
    assert run.navigator.state is NavigationState.SUCCEEDED, run.navigator.reason


def test_what_comes_to_light_elsewhere_does_not_stop_the_base():
    scene = Scene(((0.0, SE2(3.0, 0.0, 0.0)),), ((0.0, open_floor()), (3.0, with_post(1.6, 0.6))))
    rows, run = lock_step(scene, 25.0)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.navigator.plans == 1
    driving = rows[(rows[:, 0] > 3.0) & (rows[:, 1] < 2.7)]
    assert driving[:, 3].min() > 0.28


def test_a_cancelled_goal_is_braked_for_within_the_limits_and_ends_at_rest():
    scene = Scene(((0.0, AHEAD),), cancelled=4.0)
    rows, run = lock_step(scene, 8.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert run.navigator.reason == "cancelled"
    assert run.navigator.plans == 1
    braking = rows[rows[:, 0] > 4.0]
    assert np.diff(braking[:, 3]).min() / 0.005 > -1.5 * CONFIG.limits.a_m_s2
    assert 0.11 < braking[-1, 1] - braking[0, 1] < 0.25


def test_a_new_goal_while_driving_is_planned_from_where_the_base_will_stand():
    scene = Scene(((0.0, AHEAD), (4.0, SE2(1.0, -1.5, -1.5))))
    rows, run = lock_step(scene, 60.0)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.navigator.plans == 2, "the plan made while braking is driven"
    assert run.base.pose.distance_to(SE2(1.0, -1.5, -1.5)) < 0.02
    stood = rows[(rows[:, 0] > 4.0) & (rows[:, 3] < 0.001)]  # at rest, or on its way back already
    assert stood[0, 0] < 5.3


@pytest.mark.parametrize("goal", [SE2(1.0, -1.5, -1.5), SE2(3.0, 1.5, 0.5), SE2(-1.0, -0.5, 0.3)])
def test_between_two_goals_the_base_rests_where_it_was_expected_and_not_longer_than_it_obeys_late(goal: SE2):
    run = LockStep()
    run.go(SE2(3.0, 1.0, 0.6))
    run.drive(4.0)
    assert speeds(run)[-1] > 0.25
    run.go(goal)
    run.drive(2.0 / 15.0)
    stop = run.navigator._follower.report.stop_in("map")
    turned_s = 1e-9 * run.base.now_ns
    run.drive(2.0)
    assert stop is not None
    rows = np.array(run.base.rows)
    rows = rows[rows[:, 0] > turned_s]
    slowest = int(np.argmin(np.abs(rows[:, 3])))
    assert np.hypot(*(rows[slowest, 1:3] - (stop.x, stop.y))) < 0.02
    rests = np.abs(rows[:, 3]) < 0.005
    assert np.count_nonzero(rests) * 0.005 < 0.25
    assert run.navigator.plans == 2


def narrow_gates() -> OccupancyGrid:
    """The base at the origin stands between two posts of 1.5 cm, 10 cm from its middle; between two others 24 cm ahead
    there are 16 cm, and behind it is a wall."""
    data = np.zeros((240, 340), np.int8)
    data[[113, 126], 66] = data[[109, 131], 82] = data[:, 46] = OCCUPIED
    return OccupancyGrid(data, 0.015, -1.0, -1.8)


def test_a_base_leaves_a_narrow_place_in_one_go_while_the_map_stays_the_same():
    run, goal = LockStep(), SE2(2.0, 0.0, 0.0)
    run.planner.take_grid(narrow_gates(), run.base.now_ns)
    run.go(goal)
    while run.navigator.state is NavigationState.ACTIVE:
        run.drive(0.2)
        run.planner.take_grid(narrow_gates(), run.base.now_ns)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.base.pose.distance_to(goal) < 0.02
    assert run.navigator.plans == 1
