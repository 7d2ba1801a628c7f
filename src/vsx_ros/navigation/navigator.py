"""Driving to goals in one process, as the lock-step run does it, and what computing costs there."""

from vsx_ros.config import ComputingConfig, Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowResult
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import Follower
from vsx_ros.navigation.goal_execution import Act, Brake, Done, ExecutionInput, Follow, GoalExecution, PlanRequest
from vsx_ros.navigation.goal_planner import GoalPlanner, TimedPlan
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Refusal
from vsx_ros.robot import STOP


class ComputingTime:
    """Durations in ns of one frame, one ranking of views and one plan, from counted work: so one seed gives the same
    bytes each time."""

    def __init__(self, config: ComputingConfig) -> None:
        self._config = config

    def frame_ns(self) -> int:
        """From a frame's stamp to its pose being known."""
        return _ns(self._config.frame_ms)

    def ranking_ns(self, grid: OccupancyGrid) -> int:
        """To rank the views that a map offers."""
        return _ns(self._config.ranking_ms + self._config.ranking_ms_m2 * grid.known_area_m2)

    def plan_ns(self, answer: TimedPlan | Refusal) -> int:
        """To find a way, or that there is none, and its speeds."""
        way_m = answer.plan.path.length_m if isinstance(answer, TimedPlan) else 0.0
        return _ns(self._config.plan_ms + self._config.plan_ms_m * way_m)


def _ns(milliseconds: float) -> int:
    return round(1e6 * milliseconds)


class Navigator:
    """What the move_base and follower nodes are on the robot, made of the same parts; a plan takes emulated time."""

    def __init__(self, config: Config, planner: GoalPlanner, computing_time: ComputingTime) -> None:
        self._planner, self._computing_time = planner, computing_time
        self._execution, self._follower = GoalExecution(config), Follower(config)
        self._answer: tuple[int, int, TimedPlan | Refusal] | None = None  # known from when on, request's number, plan
        self._busy_until_ns = 0
        self.state, self.reason = NavigationState.IDLE, ""
        self.plans = 0

    def go(self, now_ns: int, goal: SE2, frame: str) -> None:
        """Pursue the goal, in ``frame``; one before it is forgotten."""
        self._execution.begin(now_ns, goal, frame)
        self.state, self.reason = NavigationState.ACTIVE, ""

    def cancel(self, now_ns: int) -> None:
        """Come to rest; then the goal has ended."""
        self._execution.cancel(now_ns, "cancelled")

    def step(self, now_ns: int, where: LocalizationState, hazards: frozenset[str] = frozenset()) -> FollowResult:
        """The velocity for now, and how the follower came to it."""
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
        """One at a time, as the planner's thread does it: an older question is answered first."""
        self.plans += 1
        way = self._planner.timed(request.start, request.goal, request.frame)
        self._busy_until_ns = max(now_ns, self._busy_until_ns) + self._computing_time.plan_ns(way)
        self._answer = self._busy_until_ns, request.number, way
