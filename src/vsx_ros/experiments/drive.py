"""Drives from a start to a goal with another heading, one per planner, tracked by two trackers (paper, Table 1).

All drives of one world begin identically, to the bit: same world, same noise, same straight start. Then the robot
follows each planner's path to the same goal by odometry. So it arrives even if a tracker is lost, and all trackers are
judged on the same drive. The frames of a drive go through both trackers."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np

from vsx_ros.config import Config, LimitsConfig, overridden
from vsx_ros.control.trajectory_tracker import FollowStatus, TrajectoryTracker
from vsx_ros.errors import InputError
from vsx_ros.experiments.trackers import Tracked, both_trackers
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.planning.path import Path, Plan, Refusal, Trajectory
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP
from vsx_ros.runs.world import world_of
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.truth import ground_truth_grid

ARMS: dict[str, tuple[str, float | None]] = {
    "constrained": ("fov", None),
    "unconstrained": ("unconstrained", 0.9),
    "unconstrained, slow turns": ("unconstrained", 0.3),  # motion blur is at most 3 px
    "the paper's planner": ("paper", None),
}
"""One of PLANNERS, and its limit of the turn rate [rad/s]; None for the robot's own."""
CONSTRAINED, UNCONSTRAINED, *_ = ARMS
START_M = 0.6  # driven straight at first, where the map starts
PHI_RAD_M = 1.0  # of every drive
# Wide limits of the follower, so that small deviations are corrected and all arms reach the goal.
CONFIG = overridden(
    Config(),
    {"planner.phi_rad_m": PHI_RAD_M, "follower.max_heading_error_rad": 0.8, "follower.max_lateral_error_m": 0.3},
)
_TURNS = {1: (math.radians(60.0), math.radians(110.0)), 2: (math.radians(150.0), math.pi)}
_DISTANCE_M = (1.5, 3.5)  # to a goal: far enough for full speed, near enough for most rooms
_AROUND_M = np.linspace(-0.4, 0.4, 9)
_LONGEST_PATH_M, _TRIES, _LONGEST_DRIVE_S = 12.0, 200, 180.0  # m, three times the farthest goal; draws; s


class DriveTask(NamedTuple):
    """dataset: 1, the goal's heading is to the side; 2, it is backwards. noise: number of the sample of the robot's and
    camera's errors, from 0."""

    world: str
    seed: int
    noise: int
    dataset: int


class Question(NamedTuple):
    """start, goal: poses in the world. grid: the true map, known to all planners."""

    start: SE2
    goal: SE2
    grid: OccupancyGrid


def question(task: DriveTask, world: EmulatedWorld, config: Config) -> Question:
    """A goal of the dataset's kind that the constrained and the unconstrained planner reach, drawn with the world's
    seed. Raises InputError when none is found."""
    ground = config.ground_map
    grid = ground_truth_grid(world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m)
    start = world.start_pose @ SE2(START_M, 0.0, 0.0)
    rng = np.random.default_rng([task.seed, task.dataset, 5])
    low, high = _TURNS[task.dataset]
    for _ in range(_TRIES):
        bearing, distance = rng.uniform(-math.pi, math.pi), rng.uniform(*_DISTANCE_M)
        turn = rng.uniform(low, high) * rng.choice([-1.0, 1.0])
        x, y = start.x + distance * math.cos(bearing), start.y + distance * math.sin(bearing)
        goal = SE2(x, y, float(start.theta + turn))
        if not all(grid.value_at(x + dx, y + dy) == FREE for dx in _AROUND_M for dy in _AROUND_M):
            continue
        plans = [plan_of(arm, Question(start, goal, grid), config) for arm in (CONSTRAINED, UNCONSTRAINED)]
        if all(isinstance(plan, Plan) and plan.path.length_m < _LONGEST_PATH_M for plan in plans):
            return Question(start, goal, grid)
    raise InputError(f"{task.world} {task.seed} has no goal of dataset {task.dataset} that both planners reach")


def plan_of(arm: str, asked: Question, config: Config) -> Plan | Refusal:
    """The arm's plan in the true map."""
    planner = PLANNERS[ARMS[arm][0]](config.planner, config.robot)
    return planner.plan(asked.start, asked.goal, asked.grid, np.random.default_rng(0))


def limits_of(arm: str, config: Config) -> LimitsConfig:
    """The robot's own limits, with the arm's turn rate."""
    return msgspec.structs.replace(config.limits, omega_rad_s=ARMS[arm][1] or config.limits.omega_rad_s)


def run_drives(task: DriveTask) -> dict[str, Any]:
    """Results of all arms: path, duration, planned and driven way, and each tracker's result. For an arm without a path
    the reason."""
    world = world_of(task.world, task.seed)
    asked = question(task, world, CONFIG)
    arms = {arm: _drive(arm, asked, task, world, CONFIG) for arm in ARMS}
    return {"start": _row(asked.start), "goal": _row(asked.goal), "arms": arms}


def _drive(arm: str, asked: Question, task: DriveTask, world: EmulatedWorld, config: Config) -> dict[str, Any]:
    plan = plan_of(arm, asked, config)
    if isinstance(plan, Refusal):
        return {"refused": plan.reason}
    limits, noise_seed = limits_of(arm, config), task.seed + 1000 * task.noise  # differs from other worlds' seeds
    robot = EmulatedRobot(world, noise_seed, robot=config.robot)
    trackers = both_trackers(robot, config, noise_seed)
    driver = _Driver(robot, trackers, world.start_pose)
    driver.follow(time_scale(_straight(asked, config), config.limits), config.limits, config)
    begun_ns = robot.truth.stamp_ns
    for tracked in trackers:
        tracked.begin()
    status = driver.follow(time_scale(plan.path, limits), limits, config)
    way = plan.path.sample(0.1)[:, :3]
    lasted = {"duration_s": (robot.truth.stamp_ns - begun_ns) * 1e-9, "ended": status.value}
    ways = {"planned": way.round(3).tolist(), "driven": driver.driven(begun_ns)}
    judged = {t.name: t.judged(driver.truth, driver.odometry) for t in trackers}
    return {**shape_of(plan.path), **lasted, "collisions": robot.truth.collisions, **ways, "trackers": judged}


def shape_of(path: Path) -> dict[str, float]:
    """Length, reverse length and turns on the spot of a path."""
    return {"path_m": path.length_m, "reverse_m": path.reverse_m, "turn_on_spot_rad": path.turn_on_spot_rad}


def _straight(asked: Question, config: Config) -> Path:
    """The straight start of every drive, long enough for the two frames that start the map."""
    begin = asked.start @ SE2(-START_M, 0.0, 0.0)
    plan = Planner(config.planner, config.robot).plan_blind(begin, asked.start)
    assert isinstance(plan, Plan)
    return plan.path


class _Driver:
    """Drives trajectories of the world frame by odometry, and gives the frames to the trackers."""

    def __init__(self, robot: EmulatedRobot, trackers: Sequence[Tracked], start: SE2) -> None:
        self._robot, self._trackers, self._start = robot, trackers, start
        self._command = STOP
        self.truth: list[StampedPose] = []
        self.odometry: list[SE3] = []
        self._bases: list[SE2] = []

    def follow(self, trajectory: Trajectory, limits: LimitsConfig, config: Config) -> FollowStatus:
        """Drive until it arrives, diverges or takes too long (STALE); returns how it ended."""
        tracker = TrajectoryTracker(config.follower, limits)
        tracker.start(trajectory, self._robot.truth.stamp_ns)
        ends_ns = self._robot.truth.stamp_ns + int(_LONGEST_DRIVE_S * 1e9)
        while self._robot.truth.stamp_ns < ends_ns:
            stamp_ns, pose = self._step()
            result = tracker.command(stamp_ns, pose, 0.0, True)
            self._command = result.command
            if result.status in (FollowStatus.ARRIVED, FollowStatus.DIVERGED):
                self._command = STOP
                return result.status
        return FollowStatus.STALE

    def driven(self, since_ns: int) -> list[list[float]]:
        """The base's true poses, every fourth frame."""
        poses = [base for base, pose in zip(self._bases, self.truth, strict=True) if pose.stamp_ns >= since_ns]
        return [_row(pose) for pose in poses[::4]]

    def _step(self) -> tuple[int, SE2]:
        frame, odometry = self._robot.step(self._command)
        for tracked in self._trackers:
            tracked.track(frame, odometry)
        self.truth.append(StampedPose(frame.stamp_ns, self._robot.truth.T_world_cam))
        self._bases.append(self._robot.truth.T_world_base)
        self.odometry.append(SE3.from_se2(odometry.T_odom_base) @ self._robot.T_base_cam_given)
        return frame.stamp_ns, self._start @ odometry.T_odom_base


def _row(pose: SE2) -> list[float]:
    return [round(pose.x, 3), round(pose.y, 3), round(pose.theta, 4)]
