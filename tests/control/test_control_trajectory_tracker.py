"""Following: a simulated base with late, noisy, sometimes missing poses and unequal wheels ends where it should."""

import math

import numpy as np
import pytest
from following import drive

from vsx_ros.config import FollowerConfig, LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.control.trajectory_tracker import FollowStatus, TrajectoryTracker
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, integrate
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Plan, Trajectory, certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.planners import UnconstrainedPlanner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP

LIMITS, FOLLOWER = LimitsConfig(), FollowerConfig()


def straight(length: float) -> Trajectory:
    direction = 1 if length > 0 else -1
    pieces = (arc_piece(SE2(), 0.0, abs(length), direction),)
    return time_scale(certified(SE2(), SE2(length, 0.0, 0.0), pieces, "arcs and lines"), LIMITS)


def test_it_arrives_within_centimetres_despite_latency_dropouts_and_unequal_wheels():
    rng = np.random.default_rng(5)
    drives = []
    for seed in range(10):
        path = connect(SE2(), SE2(*rng.uniform(-2.5, 2.5, 3)), 1.0)
        assert isinstance(path, Path)
        drives.append(drive(time_scale(path, LIMITS), seed))
    assert {d.status for d in drives} == {FollowStatus.ARRIVED}
    assert 0.0005 < math.sqrt(np.median([np.mean(np.square(d.lateral_m)) for d in drives])) <= 0.010
    assert np.median([d.final_m for d in drives]) <= 0.012
    assert max(d.final_m for d in drives) <= 0.03
    assert np.median([d.final_rad for d in drives]) <= math.radians(1.0)
    for d in drives:
        change = np.abs(np.diff(d.commands[:-1], axis=0)).max(axis=0) / 0.02  # the last one is the stop
        assert change[0] <= LIMITS.a_m_s2 * (1 + 1e-6)
        assert change[1] <= LIMITS.alpha_rad_s2 * (1 + 1e-6)


def test_the_generic_planners_turns_on_the_spot_are_followed_too():
    grid = OccupancyGrid(np.zeros((120, 120), np.int8), 0.05, -3.0, -3.0)
    planner = UnconstrainedPlanner(PlannerConfig(), RobotConfig())
    plan = planner.plan(SE2(), SE2(-1.0, 1.0, 0.5), grid, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    driven = drive(time_scale(plan.path, LIMITS), 3)
    assert driven.status is FollowStatus.ARRIVED
    assert driven.final_m <= 0.05
    assert driven.final_rad <= math.radians(3.5)


def follow_exactly(tracker: TrajectoryTracker, pose: SE2, start_ns: int, seconds: float, **kwargs):
    """A perfect base for a while; the last result, the pose and the time after it."""
    now, result = start_ns, None
    for _ in range(round(seconds / 0.02)):
        now += 20_000_000
        result = tracker.command(now, pose, kwargs.get("age", 0.0), kwargs.get("ok", True))
        pose = integrate(pose, result.command.v * 0.02, result.command.omega * 0.02)
    return result, pose, now


@pytest.mark.parametrize("sign", [1, -1])
def test_stale_poses_stop_the_base_on_the_path_and_fresh_ones_resume(sign):
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(2.0 * sign), 0)
    result, pose, now = follow_exactly(tracker, SE2(), 0, 4.0)
    assert result.status is FollowStatus.FOLLOWING
    assert result.command.v == pytest.approx(LIMITS.v_m_s * sign, abs=0.01)
    stop_at = tracker.predicted_stop()
    assert stop_at is not None
    speeds = [result.command.v]
    for _ in range(100):
        result, pose, now = follow_exactly(tracker, pose, now, 0.02, ok=False)
        assert result.status is FollowStatus.STALE
        assert "lost" in result.reason
        speeds.append(result.command.v)
    assert speeds[-1] == 0.0
    assert np.max(np.abs(np.diff(speeds))) <= LIMITS.a_m_s2 * 0.02 * 1.5
    assert pose.distance_to(stop_at) < 0.02
    assert abs(pose.y) < 1e-9
    held = tracker.progress_s
    result, pose, now = follow_exactly(tracker, pose, now, 0.02)
    assert result.status is FollowStatus.FOLLOWING
    assert tracker.progress_s == pytest.approx(held, abs=0.03)
    result, pose, now = follow_exactly(tracker, pose, now, 12.0)
    assert pose.distance_to(SE2(2.0 * sign, 0.0, 0.0)) < 0.006


def test_a_base_that_cannot_go_on_from_where_it_was_held_says_so(monkeypatch):
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(2.0), 0)
    _, pose, now = follow_exactly(tracker, SE2(), 0, 4.0)
    result, pose, now = follow_exactly(tracker, pose, now, 3.0, ok=False)
    assert tracker.stands
    monkeypatch.setattr("vsx_ros.control.trajectory_tracker.retime", lambda *_: None)
    result = tracker.command(now + 20_000_000, pose, 0.0, True)
    assert result.status is FollowStatus.DIVERGED
    assert result.command == STOP
    assert "was held" in result.reason


def test_it_goes_on_whenever_it_is_let_go_even_just_before_it_stands():
    for hold_s in np.arange(0.2, 0.8, 0.001):
        tracker = TrajectoryTracker(FOLLOWER, LIMITS)
        tracker.start(straight(2.0), 0)
        _, pose, now = follow_exactly(tracker, SE2(), 0, 2.0)
        while now_left := min(0.02, hold_s):
            hold_s -= now_left
            now += round(1e9 * now_left)
            result = tracker.command(now, pose, 0.0, True, waits_for="a person")
            pose = integrate(pose, result.command.v * now_left, result.command.omega * now_left)
        for _ in range(10):
            now += 20_000_000
            result = tracker.command(now, pose, 0.0, True)
            assert result.status is FollowStatus.FOLLOWING, result
            pose = integrate(pose, result.command.v * 0.02, result.command.omega * 0.02)


@pytest.mark.parametrize("behind_m", [0.1, -0.05])
def test_a_held_base_off_its_place_on_the_path_comes_to_rest_within_the_limits_too(behind_m):
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(2.0), 0)
    result, pose, now = follow_exactly(tracker, SE2(), 0, 2.0)
    pose, speeds = pose @ SE2(-behind_m, 0.0, 0.0), [result.command.v]
    for _ in range(60):
        now += 20_000_000
        result = tracker.command(now, pose, 0.0, True, waits_for="a person")
        pose = integrate(pose, 0.02 * result.command.v, 0.0)
        speeds.append(result.command.v)
    assert speeds[0] > 0.2
    assert speeds[-1] == 0.0
    assert np.abs(np.diff(speeds)).max() <= LIMITS.a_m_s2 * 0.02 + 1e-9


def test_every_kind_of_staleness_is_named():
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(1.0), 0)
    assert "no pose" in tracker.command(10**7, None, math.inf, True).reason
    assert "old" in tracker.command(2 * 10**7, SE2(), 0.7, True).reason
    assert "old" in tracker.command(3 * 10**7, SE2(), math.nan, True).reason
    assert tracker.command(4 * 10**7, SE2(), 0.7, True).command == STOP


@pytest.mark.parametrize(
    ("offset", "word"), [(SE2(0, 0.2, 0), "beside"), (SE2(0, 0, 0.4), "heading"), (SE2(-0.6, 0, 0), "behind")]
)
def test_divergence_stops_and_says_why(offset, word):
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(1.0), 0)
    result = tracker.command(10**7, offset, 0.0, True)
    assert result.status is FollowStatus.DIVERGED
    assert word in result.reason
    assert result.command == STOP
    assert tracker.command(2 * 10**7, SE2(), 0.0, True).status is FollowStatus.IDLE


def test_the_command_never_exceeds_the_limits_nor_turns_a_standing_base():
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    tracker.start(straight(1.0), 0)
    pose, now = SE2(0.0, 0.1, 0.2), 0
    for _ in range(700):
        now += 20_000_000
        result = tracker.command(now, pose, 0.0, True)
        assert abs(result.command.v) <= LIMITS.v_m_s + 1e-12
        assert abs(result.command.omega) <= LIMITS.omega_rad_s + 1e-12
        if result.status is FollowStatus.ARRIVED:
            break
        pose = integrate(pose, result.command.v * 0.02, result.command.omega * 0.02)
    assert result.status is FollowStatus.ARRIVED
    assert pose.distance_to(SE2(1.0, 0.0, 0.0)) < 0.02
    tracker.start(straight(1.0), now)
    assert tracker.command(now, SE2(0.0, 0.05, 0.1), 0.0, True).command.omega == 0.0


def test_slowing_down_and_cancelling():
    tracker = TrajectoryTracker(FOLLOWER, LIMITS)
    assert tracker.command(0, SE2(), 0.0, True).status is FollowStatus.IDLE
    assert tracker.predicted_stop() is None
    tracker.start(straight(2.0), 0)
    now, pose = 0, SE2()
    for _ in range(300):
        now += 20_000_000
        result = tracker.command(now, pose, 0.0, True, speed_factor=0.5)
        pose = integrate(pose, result.command.v * 0.02, 0.0)
    assert result.command.v == pytest.approx(0.5 * LIMITS.v_m_s, rel=0.05)
    tracker.cancel()
    assert tracker.command(now, pose, 0.0, True).command == STOP
    tracker.start(straight(2.0), now)
    with pytest.raises(InputError, match="None"):
        tracker.command(now, SE2(math.nan, 0.0, 0.0), 0.0, True)
