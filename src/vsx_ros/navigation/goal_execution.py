"""Executes a goal from its first plan to its end: plan, hand over to the follower, watch, plan again, give up.

             begin              way found, base stands or will
    IDLE ------------> PLANNING ---------------------------------> DRIVING ----(arrived)----> IDLE
      ^                 |    ^                                      |   |
      |   (no way)      |    +--(strayed; off goal; obstacle: brake)+   |
      +-----------------+                                               |
      +<---- RESTING <----(cancelled: brake; nothing left to try)-------+

While operator or dock hold the wheels, PLANNING waits, and no try is used up. ``step`` takes what is known and returns
what to do. The caller passes the planner's answers to ``planned``."""

import math
from enum import Enum
from typing import NamedTuple

from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import FollowerReport
from vsx_ros.navigation.way_watch import WayWatch, frame_in_map
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.corridor import braking_before
from vsx_ros.planning.path import Refusal, TimedPlan
from vsx_ros.robot import MAP_FRAME

_FOLLOWER_S, _UNTAKEN_S = 1.0, 5.0  # The follower reports five times a second, and at once when it takes a drive
_PLANNER_S = 15.0  # Plans take a second or two; a planner that needs this long hangs
_STAND_WAIT_S = 1.5  # longest wait until odometry says that the base stands; then a plan is made anyway
_NEARER_M = 1.0  # A plan shorter than all before by more is progress: the goal gets its tries again
_NEAR_ALONG_M, _NEAR_BESIDE_M, _NEAR_RAD = 0.08, 0.04, 0.06  # off a plan's start, or off the goal


class ExecutionInput(NamedTuple):
    """What is known. follower: its newest report; follower_age_s: its age. silent_client: name of a client that wanted
    the goal and no longer renews it; empty if there is none."""

    where: LocalizationState
    grid: OccupancyGrid | None
    follower: FollowerReport
    follower_age_s: float = 0.0
    silent_client: str = ""


class PlanRequest(NamedTuple):
    """Plan, and answer with this number. T_map_frame: the frame in the map; None while unknown. again: why the previous
    plan was not followed to its end; empty at first."""

    number: int
    start: SE2
    goal: SE2
    frame: str
    T_map_frame: SE2 | None
    again: str


class Follow(NamedTuple):
    """Let the follower follow the plan, from rest. identity: names the trajectory in the follower's reports."""

    identity: int
    way: TimedPlan
    frame: str


class Brake(NamedTuple):
    """Let the follower stop on the path by a_m_s2 [m/s2]; infinite: at once."""

    a_m_s2: float


class Done(NamedTuple):
    """The goal has ended."""

    arrived: bool
    reason: str


Act = PlanRequest | Follow | Brake | Done


class _Phase(Enum):
    IDLE = "idle"
    PLANNING = "planning"
    DRIVING = "driving"
    RESTING = "resting"


class GoalExecution:
    """One goal at a time; not thread-safe."""

    def __init__(self, config: Config) -> None:
        self._limits, self._watch = config.limits, WayWatch(config)
        self._replans = config.follower.replans_after_divergence
        self._phase, self._since_ns = _Phase.IDLE, 0
        self._goal, self._frame = SE2(), MAP_FRAME
        self._replans_left, self._least_m = 0, math.inf
        self._again, self._number, self._epoch = "", 0, -1
        self._waits_for_plan = self._start_is_predicted = False
        self._answer: TimedPlan | Refusal | None = None
        self._asked_in: OccupancyGrid | None = None
        self._driven: Follow | None = None
        self._braking_m_s2 = 0.0
        self._ending = ""

    def begin(self, now_ns: int, goal: SE2, frame: str) -> None:
        """Pursue this goal, in ``frame``, from now on; a previous goal gets no ``Done`` any more."""
        self._goal, self._frame, self._again, self._epoch = goal, frame, "", -1
        self._replans_left, self._least_m = self._replans, math.inf
        self._enter(_Phase.PLANNING, now_ns)

    def cancel(self, now_ns: int, reason: str) -> None:
        """Come to rest, then end for that reason."""
        if self._phase in (_Phase.PLANNING, _Phase.DRIVING):
            self._ending = reason
            self._enter(_Phase.RESTING, now_ns)

    def planned(self, now_ns: int, number: int, answer: TimedPlan | Refusal) -> None:
        """Take the planner's answer; an answer to an older request is ignored."""
        if number == self._number and self._waits_for_plan:
            self._answer, self._waits_for_plan, self._since_ns = answer, False, now_ns

    def step(self, now_ns: int, seen: ExecutionInput) -> list[Act]:
        """What to do now, in this order."""
        if self._phase is _Phase.IDLE:
            return []
        if seen.silent_client:
            return [self._done(False, f"the client {seen.silent_client} is silent")]
        if self._frame != MAP_FRAME and seen.where.odometry is not None:
            before, self._epoch = self._epoch, seen.where.odom_epoch
            if before not in (-1, self._epoch):  # the goal's numbers mean another place now
                self.cancel(now_ns, "the odometry has restarted; send the goal again")
        if self._was_held(seen.follower) and self._phase in (_Phase.PLANNING, _Phase.DRIVING):
            self._driven = None
            self._enter(_Phase.PLANNING, now_ns)
            return []
        if self._phase is _Phase.DRIVING and (done := self._verdict(now_ns, seen)) is not None:
            return [done]
        acts = self._brake(now_ns, seen)
        if self._phase is _Phase.PLANNING:
            acts += self._prepare(now_ns, seen)
        elif self._phase is _Phase.RESTING and not acts and self._has_rested(now_ns, seen):
            acts.append(self._done(False, self._ending))
        return acts

    def _was_held(self, report: FollowerReport) -> bool:
        """Whether the operator holds the wheels, or did between two steps: our trajectory is dropped, nothing ended."""
        dropped = self._driven is not None and report.trajectory == self._driven.identity
        return report.status is FollowStatus.HELD or (dropped and report.status is FollowStatus.IDLE)

    def _enter(self, phase: _Phase, now_ns: int) -> None:
        self._phase, self._since_ns = phase, now_ns
        self._answer, self._waits_for_plan = None, False

    def _done(self, arrived: bool, reason: str) -> Done:
        self._enter(_Phase.IDLE, 0)
        self._driven = None
        return Done(arrived, reason)

    def _has_rested(self, now_ns: int, seen: ExecutionInput) -> bool:
        """Whether the base has stopped: a plan begins at rest."""
        return seen.where.stands or now_ns - self._since_ns > _STAND_WAIT_S * 1e9

    def _prepare(self, now_ns: int, seen: ExecutionInput) -> list[Act]:
        pose = seen.where.pose(self._frame)
        if self._waits_for_plan:
            waits = now_ns - self._since_ns <= _PLANNER_S * 1e9
            return [] if waits else [self._done(False, f"the planner has not answered within {_PLANNER_S:g} s")]
        if self._answer is None and not seen.where.stands and (stop := seen.follower.stop_in(self._frame)) is not None:
            return [self._ask(now_ns, stop, seen, predicted=True)]  # where the base will stand
        if not (self._comes_to_rest(seen.follower, pose) or self._has_rested(now_ns, seen)):
            return []
        if pose is None:
            return [self._done(False, f"no pose of the base in frame {self._frame!r}; goals are in map or odom")]
        if self._answer is None or (self._start_is_predicted and not _near(self._start, pose)):
            return [self._ask(now_ns, pose, seen, predicted=False)]
        if isinstance(self._answer, Refusal):
            return [self._done(False, self._answer.reason)]
        if (way_m := self._answer.plan.path.length_m) < self._least_m - _NEARER_M:
            self._replans_left, self._least_m = self._replans, way_m
        self._driven = follow = Follow(now_ns, self._answer, self._frame)
        self._braking_m_s2 = 0.0
        self._watch.begin(self._asked_in, self._answer.clearance_m)
        self._enter(_Phase.DRIVING, now_ns)
        return [follow]

    def _comes_to_rest(self, report: FollowerReport, pose: SE2 | None) -> bool:
        """Whether the base is told to stand, where the plan begins. It obeys late, and will obey the plan late, too."""
        planned = self._start_is_predicted and isinstance(self._answer, TimedPlan)
        return planned and report.status is FollowStatus.STOPPED and pose is not None and _near(self._start, pose)

    def _ask(self, now_ns: int, start: SE2, seen: ExecutionInput, *, predicted: bool) -> PlanRequest:
        self._number += 1
        self._start, self._start_is_predicted, self._asked_in = start, predicted, seen.grid
        self._waits_for_plan, self._answer, self._since_ns = True, None, now_ns
        return PlanRequest(
            number=self._number, start=start, goal=self._goal, frame=self._frame,
            T_map_frame=frame_in_map(self._frame, seen.where), again=self._again,
        )  # fmt: skip

    def _verdict(self, now_ns: int, seen: ExecutionInput) -> Done | None:
        """The end of the goal, if the follower's report means that."""
        assert self._driven is not None
        if min(seen.follower_age_s, driven_s := 1e-9 * (now_ns - self._driven.identity)) > _FOLLOWER_S:
            return self._done(False, "the follower is silent")
        if seen.follower.trajectory != self._driven.identity:
            return self._done(False, "the drive has not reached the follower") if driven_s > _UNTAKEN_S else None
        status, reason, error = seen.follower.status, seen.follower.reason, seen.follower.error
        missed = status is FollowStatus.ARRIVED and error is not None and not _near(SE2(), SE2(*error))
        if status in (FollowStatus.ARRIVED, FollowStatus.STOPPED) and not missed:
            return self._done(status is FollowStatus.ARRIVED, reason)
        if status is FollowStatus.DIVERGED or missed:
            self._driven = None
            self._try_again(now_ns, f"{reason}, too far" if missed else reason)
        return None

    def _try_again(self, now_ns: int, reason: str) -> None:
        """Plan again, a few times without progress; then give up."""
        if self._replans_left > 0:
            self._replans_left -= 1
            self._again = reason
            self._enter(_Phase.PLANNING, now_ns)
        else:
            self._ending = reason
            self._enter(_Phase.RESTING, now_ns)

    def _brake(self, now_ns: int, seen: ExecutionInput) -> list[Act]:
        """Brake for what a new map shows on the path, in every phase, and for a path that is not driven to its end."""
        if self._driven is None:
            return []
        found, wanted = None, 0.0
        if seen.grid is not None and seen.follower.trajectory == self._driven.identity:
            way, at_s = self._driven.way.trajectory, seen.follower.progress_s(seen.follower_age_s)
            found = self._watch.hindrance(way, self._driven.frame, at_s, seen.grid, seen.where)
        if found is not None and found.ahead_m is not None:
            v_m_s = seen.where.odometry.v if seen.where.odometry is not None else 0.0
            wanted = braking_before(found.ahead_m, v_m_s, self._limits, way, at_s)
        if found is not None and self._phase is _Phase.DRIVING:
            self._try_again(now_ns, found.reason)
        if self._phase is not _Phase.DRIVING:
            wanted = max(wanted, self._limits.a_m_s2)
        harder = wanted > self._braking_m_s2
        self._braking_m_s2 = max(wanted, self._braking_m_s2)
        return [Brake(wanted)] if harder else []


def _near(planned: SE2, real: SE2) -> bool:
    """Whether a path planned from one pose may be followed from the other: the follower corrects the difference."""
    off = planned.inverse() @ real
    return abs(off.x) <= _NEAR_ALONG_M and abs(off.y) <= _NEAR_BESIDE_M and abs(planned.angle_to(real)) <= _NEAR_RAD
