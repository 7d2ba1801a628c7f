"""From a goal to a timed way there, in the newest map or by odometry alone."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.control.localization import MAP_FRAME, ODOM_FRAME
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.corridor import Visibility
from vsx_ros.planning.path import Plan, Refusal, RefusalKind, Trajectory
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.planning.time_scaling import time_scale

_SAME_MAP_NS = 3_000_000_000  # landmarks so much older or newer than the map are not of it


class TimedPlan(NamedTuple):
    """A way and how fast it is driven."""

    plan: Plan
    trajectory: Trajectory


class GoalPlanner:
    """``grid`` and ``landmarks`` are handed over as they come, each with its stamp [ns]; plans from one thread at a
    time."""

    def __init__(self, config: Config, kind: str, seed: int) -> None:
        """kind: a name of PLANNERS. Raises ConfigError for another."""
        self._kind = PLANNERS[kind]
        self._rng = np.random.default_rng(seed)
        self._grid_ns = self._landmarks_ns = 0
        self._landmarks: FloatArray = np.zeros((0, 3))
        self.grid: OccupancyGrid | None = None
        self.change(config)

    def change(self, config: Config) -> None:
        """Plan otherwise from now on."""
        self._config, self.blind = config, Planner(config.planner, config.robot)
        self._planner = self._kind(config.planner, config.robot)

    def take_grid(self, grid: OccupancyGrid, stamp_ns: int) -> None:
        """The newest map."""
        self.grid, self._grid_ns = grid, stamp_ns

    def take_landmarks(self, points_map: FloatArray, stamp_ns: int) -> None:
        """The newest points (N, 3) of the map [m]."""
        self._landmarks, self._landmarks_ns = points_map, stamp_ns

    def timed(self, start: SE2, goal: SE2, frame: str) -> TimedPlan | Refusal:
        """A plan as of ``plan``, with the speeds to drive it at; what cannot be planned is refused."""
        config = self._config
        try:
            plan = self.plan(start, goal, frame)
            if isinstance(plan, Refusal):
                return plan
            return TimedPlan(plan, time_scale(plan.path, config.limits, plan.blind_spans, config.planner.blind_v_m_s))
        except PlanningError as error:
            return Refusal(RefusalKind.INFEASIBLE, str(error))

    def plan(self, start: SE2, goal: SE2, frame: str) -> Plan | Refusal:
        """From start to goal, both in ``frame``: in map by the newest map, in odom blindly.

        Raises PlanningError for poses that are not finite.
        """
        grid = self.grid
        if frame == ODOM_FRAME:
            return self.blind.plan_blind(start, goal)
        if frame != MAP_FRAME:
            return Refusal(RefusalKind.INFEASIBLE, f"goals are in map or odom, not in frame {frame!r}")
        if grid is None:
            return Refusal(RefusalKind.INFEASIBLE, "there is no map yet to plan in")
        return self._planner.plan(start, goal, grid, self._rng, self._visibility())

    def plan_between(self, start: tuple[str, SE2], goal: tuple[str, SE2]) -> Plan | Refusal:
        """The same for poses that each name their frame."""
        if start[0] != goal[0]:
            return Refusal(
                RefusalKind.INFEASIBLE, f"the start is in frame {start[0]!r}, the goal in {goal[0]!r}; give both in one"
            )
        return self.plan(start[1], goal[1], goal[0])

    def _visibility(self) -> Visibility | None:
        """What to keep in view; None where no landmarks belong to the map at hand."""
        if len(self._landmarks) == 0 or abs(self._landmarks_ns - self._grid_ns) > _SAME_MAP_NS:
            return None
        return Visibility(self._landmarks, self._config.planner)
