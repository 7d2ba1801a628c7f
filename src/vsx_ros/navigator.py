"""The pursuit of one goal: a plan, and the velocities that follow it while the newest map allows it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.control.caution import Caution
from vsx_ros.control.pose_fusion import PoseFuser
from vsx_ros.control.trajectory_tracker import FollowResult, FollowStatus, TrajectoryTracker
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.ahead import obstacle_ahead
from vsx_ros.planning.path import Refusal, Trajectory
from vsx_ros.planning.planner import Planner, UnconstrainedPlanner
from vsx_ros.planning.sight import Sight
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP, Odometry
from vsx_ros.slam.state import TrackingState


class Surroundings(NamedTuple):
    """What a plan takes into account: the map, if there is one, and landmarks (M, 3) [m] to keep in view."""

    grid: OccupancyGrid | None
    landmarks_world: FloatArray


class Navigator:
    """Plans to a goal and follows the plan; what the move_base and follower nodes are on the robot."""

    def __init__(self, config: Config, planner: Planner | UnconstrainedPlanner, seed: int) -> None:
        self._config = config
        self._planner = planner
        self._blind = Planner(config.planner, config.robot)
        self._rng = np.random.default_rng(seed)
        self._tracker = TrajectoryTracker(config.follower, config.limits)
        self._caution = Caution(config.follower)
        self._frame = "map"
        self._goal = SE2()
        self._replans_left = 0
        self._replanning = ""
        self._checked: OccupancyGrid | None = None
        self.state = NavigationState.IDLE
        self.reason = ""
        self.trajectory: Trajectory | None = None
        self.plans = 0

    def go(
        self,
        now_ns: int,
        start: SE2 | None,
        goal: SE2,
        frame: str,
        around: Surroundings,
    ) -> None:
        """Plan from start to goal (both in ``frame``) and begin to follow, or end ABORTED with the reason.

        Where the base leaves the path, or a newer map shows an obstacle on it, the base stops, and another path is
        planned from there, a few times.
        """
        self._frame, self._goal, self._replanning = frame, goal, ""
        self._replans_left = self._config.follower.replans_after_divergence
        self._begin(now_ns, start, around)

    def _begin(self, now_ns: int, start: SE2 | None, around: Surroundings) -> None:
        self.plans += 1
        (grid, landmarks_world), goal, frame = around, self._goal, self._frame
        if start is None or (frame == "map" and grid is None):
            self._end(NavigationState.ABORTED, "no pose or no map to plan with")
            return
        if frame == "odom" or grid is None:
            plan = self._blind.plan_blind(start, goal)
        elif isinstance(self._planner, Planner) and len(landmarks_world):
            sight = Sight.of(landmarks_world, self._config.planner)
            plan = self._planner.plan(start, goal, grid, self._rng, sight)
        else:
            plan = self._planner.plan(start, goal, grid, self._rng)
        if isinstance(plan, Refusal):
            self._end(NavigationState.ABORTED, plan.reason)
            return
        config = self._config
        self.trajectory = time_scale(plan.path, config.limits, plan.blind_spans, config.planner.blind_v_m_s)
        self._tracker.start(self.trajectory, now_ns)
        self.state, self.reason, self._checked = NavigationState.ACTIVE, "", grid

    def cancel(self) -> None:
        """Give up the goal; the wheels stop at the next command."""
        self._tracker.cancel()
        self._end(NavigationState.ABORTED, "cancelled")

    def command(
        self, now_ns: int, odometry: Odometry, fuser: PoseFuser, state: TrackingState, around: Surroundings
    ) -> FollowResult:
        """The velocity that follows the plan; a stop when there is none."""
        if self.state is not NavigationState.ACTIVE:
            return FollowResult(STOP, FollowStatus.IDLE, "")
        blind = self._frame == "odom"
        pose = odometry.T_odom_base if blind else fuser.pose()
        if self._replanning:
            if not odometry.stands:
                return FollowResult(STOP, FollowStatus.DIVERGED, self._replanning)
            self._replanning = ""
            self._begin(now_ns, pose, around)
            return FollowResult(STOP, FollowStatus.IDLE, self.reason)
        if obstacle := self._obstacle_ahead(around.grid):
            self._tracker.cancel()
            result = FollowResult(STOP, FollowStatus.DIVERGED, obstacle)
        elif blind:
            result = self._tracker.command(now_ns, pose, 0.0, True)
        else:
            factor = self._caution.speed_factor(now_ns, state)
            result = self._tracker.command(now_ns, pose, fuser.slam_age_s(now_ns), state.tracked, factor)
        if result.status is FollowStatus.ARRIVED:
            self._end(NavigationState.SUCCEEDED, result.reason)
        elif result.status is FollowStatus.DIVERGED and self._replans_left > 0:
            self._replans_left -= 1
            self._replanning = result.reason
        elif result.status is FollowStatus.DIVERGED:
            self._end(NavigationState.ABORTED, result.reason)
        return result

    def _obstacle_ahead(self, grid: OccupancyGrid | None) -> str:
        """What a map that was not yet looked at shows on the way."""
        if self._frame == "odom" or grid is None or grid is self._checked or self.trajectory is None:
            return ""
        self._checked = grid
        return obstacle_ahead(self.trajectory, self._tracker.progress_s, grid, self._config.robot.radius_m)

    def _end(self, state: NavigationState, reason: str) -> None:
        self.state, self.reason, self.trajectory = state, reason, None
