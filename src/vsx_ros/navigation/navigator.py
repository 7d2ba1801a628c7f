"""The execution of a goal and the follower in one process, as the lock-step run steps them."""

from typing import NamedTuple

from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowResult
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.computing_time import ComputingTime
from vsx_ros.navigation.follower import Follower
from vsx_ros.navigation.goal_execution import Act, Brake, Done, ExecutionInput, Follow, GoalExecution, PlanRequest
from vsx_ros.navigation.goal_planner import GoalPlanner, TimedPlan
from vsx_ros.planning.path import Refusal
from vsx_ros.robot import STOP


class _Answer(NamedTuple):
    """A plan that is known from ready_ns on."""

    ready_ns: int
    number: int
    way: TimedPlan | Refusal


class Navigator:
    """What the move_base and follower nodes are on the robot, made of the same parts; a plan takes emulated time."""

    def __init__(self, config: Config, planner: GoalPlanner, computing_time: ComputingTime) -> None:
        self._planner, self._computing_time = planner, computing_time
        self._execution, self._follower = GoalExecution(config), Follower(config)
        self._answer: _Answer | None = None
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
        if self._answer is not None and now_ns >= self._answer.ready_ns:
            self._execution.planned(now_ns, self._answer.number, self._answer.way)
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
        self._answer = _Answer(self._busy_until_ns, request.number, way)
