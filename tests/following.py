"""A base that follows a trajectory by late, noisy, often missing poses, on wheels that are not as they should be."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.config import FollowerConfig, LimitsConfig
from vsx_ros.control.localization import Localization
from vsx_ros.control.trajectory_tracker import FollowStatus, TrajectoryTracker
from vsx_ros.geometry.se2 import SE2, body_twist, integrate, wheel_speeds
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import STOP, Odometry, VelocityCommand

WHEEL_BASE_M, STEP_S = 0.23, 0.005
NOISE = (0.01, 0.01, math.radians(0.4))
COMMAND_DELAY_S, LAG_S = 0.05, 0.08
_CONTROL, _SLAM, _BEGIN = 4, 13, 100  # steps: 50 Hz, 15 Hz, half a second


class Drive(NamedTuple):
    """lateral_m: errors on the way. final_m, final_rad: of the base when it stands. commands: v, omega at 50 Hz."""

    lateral_m: np.ndarray
    final_m: float
    final_rad: float
    status: FollowStatus
    commands: np.ndarray


def drive(
    trajectory: Trajectory,
    seed: int,
    *,
    wheel_error: float = 0.02,
    latency_s: float = 0.1,
    dropouts: float = 0.3,
    follower: FollowerConfig | None = None,
) -> Drive:
    """Either wheel is ``wheel_error`` too large or too small; SLAM at 15 Hz with 1 cm and 0.4 deg noise, commands 50 ms
    late and lagging by 80 ms."""
    rng = np.random.default_rng(seed)
    fuser, tracker = Localization(), TrajectoryTracker(follower or FollowerConfig(), LimitsConfig())
    left, right = 1.0 + wheel_error * rng.choice([-1, 1], 2)
    true, odom, v, omega, target = trajectory.at(0.0)[0], SE2(), 0.0, 0.0, STOP
    late: list[tuple[float, VelocityCommand]] = []
    poses: list[tuple[float, int, SE2]] = []
    lateral, sent = [], []
    status, ended_s = FollowStatus.IDLE, math.inf
    for k in range(int((trajectory.duration_s + 12.0) / STEP_S)):
        t, now = k * STEP_S, int(k * STEP_S * 1e9)
        if k % _CONTROL == 0:
            fuser.add_odometry(Odometry(now, odom, v, omega))
        if k % _SLAM == 0 and (rng.random() > dropouts or k == 0):
            x, y, theta = rng.normal(0.0, NOISE)
            poses.append((t + latency_s, now, SE2(true.x + x, true.y + y, true.theta + theta)))
        while poses and poses[0][0] <= t:
            fuser.add_pose(*poses.pop(0)[1:])
        if k == _BEGIN:
            tracker.start(trajectory, now)
        if k >= _BEGIN and k % _CONTROL == 0 and t < ended_s:
            result = tracker.command(now, fuser.pose(), fuser.slam_age_s(now), True)
            status = result.status
            late.append((t + COMMAND_DELAY_S, result.command))
            sent.append(result.command)
            if status is FollowStatus.FOLLOWING:
                lateral.append((true.inverse() @ trajectory.at(tracker.progress_s)[0]).y)
            elif status is not FollowStatus.STALE:
                ended_s = t
        while late and late[0][0] <= t:
            target = late.pop(0)[1]
        if t > ended_s + 0.6:
            break
        v += (target.v - v) * STEP_S / LAG_S
        omega += (target.omega - omega) * STEP_S / LAG_S
        one, other = wheel_speeds(v, omega, WHEEL_BASE_M)
        odom = integrate(odom, *body_twist(one * STEP_S, other * STEP_S, WHEEL_BASE_M))
        true = integrate(true, *body_twist(one * left * STEP_S, other * right * STEP_S, WHEEL_BASE_M))
    goal = trajectory.at(math.inf)[0]
    return Drive(
        np.array(lateral), true.distance_to(goal), abs(true.angle_to(goal)), status, np.array([*map(tuple, sent)])
    )
