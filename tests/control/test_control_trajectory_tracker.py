"""Following: a simulated base with late, noisy, sometimes missing poses and unequal wheels ends where it should."""

import math

import numpy as np
import pytest

from vsx_ros.config import FollowerConfig, LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.control.pose_fusion import PoseFuser
from vsx_ros.control.trajectory_tracker import FollowStatus, TrajectoryTracker
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.unicycle import integrate, integrate_wheels, wheel_speeds
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.connect import connect
from vsx_ros.planning.path import Path, Plan, Trajectory, certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.planner import UnconstrainedPlanner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP, Odometry, VelocityCommand

LIMITS, FOLLOWER = LimitsConfig(), FollowerConfig()
WHEEL_BASE, DT = 0.23, 0.005


def straight(length: float) -> Trajectory:
    direction = 1 if length > 0 else -1
    pieces = (arc_piece(SE2(), 0.0, abs(length), direction),)
    return time_scale(certified(SE2(), SE2(length, 0.0, 0.0), pieces, "arcs and lines"), LIMITS)


def simulate(trajectory: Trajectory, seed: int, wheel_error: float) -> tuple[list[float], SE2, FollowStatus]:
    """Lateral errors on the way, the final error and status. 100 ms SLAM latency, 30 % of the poses missing, commands
    50 ms late and lagging by 80 ms, 15 Hz SLAM with 1 cm and 0.4 deg noise."""
    rng = np.random.default_rng(seed)
    fuser, tracker = PoseFuser(), TrajectoryTracker(FOLLOWER, LIMITS)
    left, right = 1.0 + wheel_error * rng.choice([-1, 1]), 1.0 + wheel_error * rng.choice([-1, 1])
    true, odom, v, omega = trajectory.at(0.0)[0], SE2(), 0.0, 0.0
    target = STOP
    commands: list[tuple[float, VelocityCommand]] = []
    poses: list[tuple[float, int, SE2]] = []
    lateral: list[float] = []
    status, ended = FollowStatus.IDLE, math.inf
    for k in range(int((trajectory.duration_s + 12.0) / DT)):
        t = k * DT
        now = int(t * 1e9)
        if k % 4 == 0:
            fuser.add_odometry(Odometry(now, odom, v, omega))
        if k % 13 == 0 and (rng.random() > 0.3 or k == 0):
            noise = rng.normal(0.0, (0.01, 0.01, math.radians(0.4)))
            poses.append((t + 0.1, now, SE2(true.x + noise[0], true.y + noise[1], true.theta + noise[2])))
        while poses and poses[0][0] <= t:
            _, stamp, pose = poses.pop(0)
            fuser.add_slam(stamp, pose)
        if k == 100:
            tracker.start(trajectory, now)
        if k >= 100 and k % 4 == 0 and t < ended:
            result = tracker.command(now, fuser.pose(now), fuser.slam_age_s(now), True)
            status = result.status
            commands.append((t + 0.05, result.command))
            if status is FollowStatus.FOLLOWING:
                lateral.append((true.inverse() @ trajectory.at(tracker.progress_s)[0]).y)
            elif status is not FollowStatus.STALE:
                ended = t
        while commands and commands[0][0] <= t:
            target = commands.pop(0)[1]
        if t > ended + 0.6:
            break
        v += (target.v - v) * DT / 0.08
        omega += (target.omega - omega) * DT / 0.08
        one, other = wheel_speeds(v, omega, WHEEL_BASE)
        odom = integrate_wheels(odom, one * DT, other * DT, WHEEL_BASE)
        true = integrate_wheels(true, one * left * DT, other * right * DT, WHEEL_BASE)
    goal = trajectory.at(math.inf)[0]
    return lateral, SE2(true.distance_to(goal), 0.0, abs(true.angle_to(goal))), status


def test_it_arrives_within_centimetres_despite_latency_dropouts_and_unequal_wheels():
    rng = np.random.default_rng(5)
    squares, finals, headings = [], [], []
    for seed in range(10):
        path = connect(SE2(), SE2(*rng.uniform(-2.5, 2.5, 3)), 1.0)
        assert isinstance(path, Path)
        lateral, final, status = simulate(time_scale(path, LIMITS), seed, wheel_error=0.02)
        assert status is FollowStatus.ARRIVED
        squares.append(np.mean(np.square(lateral)))
        finals.append(final.x)
        headings.append(final.theta)
    assert 0.0005 < math.sqrt(np.median(squares)) <= 0.010
    assert np.median(finals) <= 0.015
    assert max(finals) <= 0.04
    assert np.median(headings) <= math.radians(1.5)


def test_the_generic_planners_turns_on_the_spot_are_followed_too():
    grid = OccupancyGrid(np.zeros((120, 120), np.int8), 0.05, -3.0, -3.0)
    planner = UnconstrainedPlanner(PlannerConfig(), RobotConfig())
    plan = planner.plan(SE2(), SE2(-1.0, 1.0, 0.5), grid, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    _, final, status = simulate(time_scale(plan.path, LIMITS), 3, wheel_error=0.02)
    assert status is FollowStatus.ARRIVED
    assert final.x <= 0.04
    assert final.theta <= math.radians(3.0)


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
