"""Plans from goal to timed path, in the newest map or by odometry alone; drives to goals in one process for the
lock-step run, and counts the computing time there."""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ComputingConfig, Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowResult
from vsx_ros.errors import PlanningError
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import KINECT_RAD, with_view
from vsx_ros.navigation.follower import Follower
from vsx_ros.navigation.goal_execution import Act, Brake, Done, ExecutionInput, Follow, GoalExecution, PlanRequest
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.keep_out import KeepOut
from vsx_ros.occupancy.zoned_grid import ZonedGrid
from vsx_ros.planning.corridor import Visibility, planned_clearance
from vsx_ros.planning.path import Plan, Refusal, RefusalKind, TimedPlan
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.planning.slow_spans import blind_spans, zone_spans
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import MAP_FRAME, ODOM_FRAME, STOP

_CHECK_STEP_M = 0.01  # between places of a way that are checked against zones
_SAME_MAP_NS = 3_000_000_000  # landmarks that are older or newer than the map by more do not belong to it


class GoalPlanner:
    """``take_grid`` and ``take_landmarks`` take new data, each with its stamp [ns]. Plan from one thread at a time."""

    def __init__(self, config: Config, kind: str, seed: int) -> None:
        """kind: a name in PLANNERS. Raises ConfigError for any other."""
        self._kind, self._fov_rad = PLANNERS[kind], KINECT_RAD
        self._rng = np.random.default_rng(seed)
        self._grid_ns = self._landmarks_ns = 0
        self._landmarks: FloatArray = np.zeros((0, 3))
        self.grid: OccupancyGrid | None = None
        self.change(config)

    def change(self, config: Config) -> None:
        """Plan with this configuration from now on."""
        self._given, self._config = config, with_view(config, self._fov_rad)
        self.blind = Planner(self._config.planner, config.robot)
        self._planner = self._kind(self._config.planner, config.robot)

    def look_with(self, fov_rad: float) -> None:
        """The camera has this field of view [rad]; the configuration may have another."""
        self._fov_rad = fov_rad
        self.change(self._given)

    def take_grid(self, grid: OccupancyGrid, stamp_ns: int) -> None:
        """Take the newest map."""
        self.grid, self._grid_ns = grid, stamp_ns

    def take_landmarks(self, points_map: FloatArray, stamp_ns: int) -> None:
        """Take the newest points (N, 3) of the map [m]."""
        self._landmarks, self._landmarks_ns = points_map, stamp_ns

    def timed(self, start: SE2, goal: SE2, frame: str, T_map_frame: SE2 | None = None) -> TimedPlan | Refusal:
        """As ``plan``, with the speeds to drive at; returns a refusal instead of raising PlanningError."""
        config, grid = self._config, self.grid
        T_map_frame = SE2() if frame == MAP_FRAME else T_map_frame
        try:
            plan = self._plan(start, goal, frame, T_map_frame, grid)
            if isinstance(plan, Refusal):
                return plan
            slow = blind_spans(plan.blind_spans, config.planner.blind_v_m_s)
            if frame == ODOM_FRAME and not len(self._landmarks):  # the camera has no map
                slow = blind_spans(np.array([[0.0, plan.path.length_m]]), config.planner.unmapped_v_m_s)
            slow = np.vstack([slow, zone_spans(plan.path, grid, T_map_frame)])
            trajectory = time_scale(plan.path, config.limits, slow)
            if frame == ODOM_FRAME or grid is None:
                return TimedPlan(plan, trajectory)
            return TimedPlan(plan, trajectory, planned_clearance(trajectory, grid, config.robot.radius_m))
        except PlanningError as error:
            return Refusal(RefusalKind.INFEASIBLE, str(error))

    def plan(self, start: SE2, goal: SE2, frame: str, T_map_frame: SE2 | None = None) -> Plan | Refusal:
        """From start to goal, both in ``frame``. In map it uses the newest map, in odom no map. T_map_frame: the frame
        odom in the map; if it is known, the way keeps out of zones there, too.

        Raises PlanningError for poses that are not finite."""
        return self._plan(start, goal, frame, T_map_frame, self.grid)

    def _plan(
        self, start: SE2, goal: SE2, frame: str, T_map_frame: SE2 | None, grid: OccupancyGrid | None
    ) -> Plan | Refusal:
        """grid: one map for the path and its speeds; another thread may take a newer one meanwhile."""
        if frame == ODOM_FRAME:
            return self._outside(self.blind.plan_blind(start, goal), grid, T_map_frame)
        if frame != MAP_FRAME:
            return Refusal(RefusalKind.INFEASIBLE, f"goals are in map or odom, not in frame {frame!r}")
        if grid is None:
            return Refusal(RefusalKind.INFEASIBLE, "there is no map yet to plan in")
        plan = self._outside(self._planner.plan(start, goal, grid, self._rng, self._visibility()), grid, SE2())
        stuck = isinstance(plan, Refusal) and self._keep_out(grid).zone_at(start.x, start.y)
        if stuck and isinstance(grid, ZonedGrid):  # out of the zone the way may lead through more of it
            opened = grid.opened_at(start.x, start.y)
            plan = self._outside(self._planner.plan(start, goal, opened, self._rng, self._visibility()), grid, SE2())
        return plan

    def _outside(self, plan: Plan | Refusal, grid: OccupancyGrid | None, T_map_frame: SE2 | None) -> Plan | Refusal:
        """The plan, or a refusal when it enters a zone. A base in a zone may leave it."""
        if isinstance(plan, Refusal) or grid is None or T_map_frame is None:
            return plan
        found = self._keep_out(grid).entered(T_map_frame @ plan.path.sample(_CHECK_STEP_M)[:, :2])
        if found is None:
            return plan
        return Refusal(RefusalKind.ZONE, f"after {found.ahead_m:.1f} m the way leads into the zone {found.zone!r}")

    def _keep_out(self, grid: OccupancyGrid) -> KeepOut:
        return KeepOut(grid, self._config.robot.radius_m)

    def _visibility(self) -> Visibility | None:
        """What to keep in view; None when no landmarks belong to the present map."""
        if len(self._landmarks) == 0 or abs(self._landmarks_ns - self._grid_ns) > _SAME_MAP_NS:
            return None
        return Visibility(self._landmarks, self._config.planner)


class ComputingTime:
    """Durations in ns of one frame, one ranking of views and one plan. They are computed from counted work, so that one
    seed gives the same bytes each time."""

    def __init__(self, config: ComputingConfig) -> None:
        self._config = config

    def frame_ns(self) -> int:
        """Time from a frame's stamp until its pose is known."""
        return round(1e6 * self._config.frame_ms)

    def ranking_ns(self, grid: OccupancyGrid) -> int:
        """Time to rank the views of a map."""
        return round(1e6 * (self._config.ranking_ms + self._config.ranking_ms_m2 * grid.known_area_m2))

    def plan_ns(self, answer: TimedPlan | Refusal) -> int:
        """Time to find a path or a refusal, and the speeds."""
        way_m = answer.plan.path.length_m if isinstance(answer, TimedPlan) else 0.0
        return round(1e6 * (self._config.plan_ms + self._config.plan_ms_m * way_m))


class Navigator:
    """Does the work of the nodes move_base and follower, with the same parts; a plan takes emulated time."""

    def __init__(self, config: Config, planner: GoalPlanner, computing_time: ComputingTime) -> None:
        self._planner, self._computing_time = planner, computing_time
        self._execution, self._follower = GoalExecution(config), Follower(config)
        self._answer: tuple[int, int, TimedPlan | Refusal] | None = None  # time when known, request's number, plan
        self._busy_until_ns = 0
        self.state, self.reason = NavigationState.IDLE, ""
        self.plans = 0

    def go(self, now_ns: int, goal: SE2, frame: str) -> None:
        """Pursue the goal, in ``frame``; it replaces any earlier one."""
        self._execution.begin(now_ns, goal, frame)
        self.state, self.reason = NavigationState.ACTIVE, ""

    def cancel(self, now_ns: int) -> None:
        """Come to rest; then the goal has ended."""
        self._execution.cancel(now_ns, "cancelled")

    def step(
        self, now_ns: int, where: LocalizationState, hazards: frozenset[str] = frozenset(), held: str = ""
    ) -> FollowResult:
        """The velocity for now, and the follower's result. held: why the operator holds the wheels; empty: he does
        not."""
        self._follower.hold(now_ns, held)
        if self._answer is not None and now_ns >= self._answer[0]:
            self._execution.planned(now_ns, *self._answer[1:])
            self._answer = None
        for act in self._execution.step(now_ns, ExecutionInput(where, self._planner.grid, self._follower.report)):
            self._do(now_ns, act)
        self._follower.take_hazards(now_ns, hazards)
        command = self._follower.step(now_ns, where) or STOP
        return self._follower.result._replace(command=command)

    def _do(self, now_ns: int, act: Act) -> None:
        if isinstance(act, PlanRequest):
            self._plan(now_ns, act)
        elif isinstance(act, Follow):
            self._follower.follow(now_ns, act.way.trajectory, act.frame, act.identity)
        elif isinstance(act, Brake):
            self._follower.brake(now_ns, act.a_m_s2)
        elif isinstance(act, Done):
            self._follower.end(now_ns, "cancelled")
            self.state = NavigationState.SUCCEEDED if act.arrived else NavigationState.ABORTED
            self.reason = act.reason

    def _plan(self, now_ns: int, request: PlanRequest) -> None:
        """One at a time, as in the planner's thread: an older request is answered first."""
        self.plans += 1
        way = self._planner.timed(request.start, request.goal, request.frame, request.T_map_frame)
        self._busy_until_ns = max(now_ns, self._busy_until_ns) + self._computing_time.plan_ns(way)
        self._answer = self._busy_until_ns, request.number, way
