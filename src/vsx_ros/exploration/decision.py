"""Types exchanged by the mission and the driving part: what is known, what to do, how it ended. Also a mission's log,
and what it saves to continue an interrupted run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.anchored_poses import KeyframePlaces
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import MAP_FRAME, OperatorHold, UserGoal
from vsx_ros.slam.state import TrackingState

SECOND_NS = 1_000_000_000


class NavigationState(Enum):
    """The state of the last goal. LOST: no fault of the goal. CANCELLED, REPLACED: by somebody else; by his goal."""

    IDLE = "idle"
    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    LOST = "lost"
    CANCELLED = "cancelled"
    REPLACED = "replaced"


class Situation(NamedTuple):
    """What the mission knows when it decides.

    T_map_base is None while no map exists. hazard names a pressed bumper or the like. landmarks_world: (M, 3).
    odom_epoch: that of T_odom_base; poses of different epochs cannot be compared.
    lifted: whether the robot is held in the air. held: the operator holds the wheels. user_goal: move_base pursues a
    goal of somebody else, in place of ours; user_goal_end: how the last such goal has ended. blind_s: time since vslam
    has used an image [s]. keyframes: of the grid; None if unknown."""

    slam_state: TrackingState
    slam_reason: str
    T_map_base: SE2 | None
    T_odom_base: SE2 | None
    grid: OccupancyGrid | None
    navigation: NavigationState
    navigation_reason: str
    hazard: str | None
    landmarks_world: FloatArray
    odom_epoch: int = 0
    lifted: bool = False
    held: OperatorHold | None = None
    user_goal: UserGoal | None = None
    user_goal_end: str = ""
    blind_s: float = 0.0
    keyframes: KeyframePlaces | None = None


class Action(Enum):
    """WAIT: continue as before. GO: a new goal. CANCEL: give up the goal and stand still. FINISH: the end."""

    WAIT = "wait"
    GO = "go"
    CANCEL = "cancel"
    FINISH = "finish"


class MissionState(Enum):
    """The boxes of the mission's diagram."""

    STARTING = "starting"
    MAPPING = "mapping"
    RECOVERING = "recovering"
    PAUSED = "paused"
    HELD = "held"
    USER_GOAL = "user goal"
    BLIND = "no images"
    DONE = "done"


class Outcome(Enum):
    """How a mission ended."""

    EXPLORED = "explored"
    HOME = "returned home"
    STOPPED = "stopped by the operator"
    BOXED_IN = "no view can be driven to"
    NOT_STARTED = "the map could not be started"
    LOST = "tracking lost for good"
    STRANDED = "home could not be reached"
    BLOCKED = "stopped by a hazard that stays"
    BLIND = "no images come"


class Decision(NamedTuple):
    """One action; goal and frame ('map' or 'odom') only with GO."""

    action: Action
    goal: SE2 | None
    frame: str
    state: str
    reason: str


def without_figures(reason: str) -> str:
    """The words of a reason; its figures, in brackets at the end, are for those who want to know more."""
    return reason.partition(" [")[0]


class MissionEvent(NamedTuple):
    """A change of state or a choice, for people."""

    stamp_ns: int
    state: str
    reason: str


class MissionLog:
    """Creates a mission's decisions and logs the choices among them. state: the present box of the mission's diagram.
    outcome: how it ended, if it has. reason: of the last entry. wait_until_ns: until then there is nothing to decide.
    """

    def __init__(self) -> None:
        self.state = MissionState.STARTING
        self.outcome: Outcome | None = None
        self.reason = ""
        self.wait_until_ns = 0
        self._purpose = ""
        self._events: list[MissionEvent] = []

    def enter(self, now_ns: int, state: MissionState, reason: str) -> None:
        """Enter a state and log it."""
        self.state = state
        self.note(now_ns, reason)

    def note(self, now_ns: int, reason: str) -> None:
        """Log a choice."""
        self.reason = reason
        self._events.append(MissionEvent(now_ns, self.state.value, reason))

    def answer(self, action: Action, reason: str) -> Decision:
        """Any decision but a new goal."""
        return Decision(action, goal=None, frame=MAP_FRAME, state=self.state.value, reason=reason)

    def go(self, now_ns: int, goal: SE2, frame: str, reason: str) -> Decision:
        """A new goal."""
        self._purpose = reason
        self.note(now_ns, reason)
        return Decision(Action.GO, goal=goal, frame=frame, state=self.state.value, reason=reason)

    def on_the_way(self) -> Decision:
        """Let the drive to the last goal continue."""
        return self.answer(Action.WAIT, f"on the way: {self._purpose}")

    def finish(self, now_ns: int, outcome: Outcome, reason: str) -> Decision:
        """End the mission; later calls do not change the outcome."""
        if self.state is not MissionState.DONE:
            self.outcome = outcome
            self.enter(now_ns, MissionState.DONE, reason)
        return self.answer(Action.FINISH, self.reason)

    def drain(self) -> list[MissionEvent]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events


_MOST = 1e9  # seconds or metres of a run
_MOST_TIMES = 1_000_000  # that one goal fails in a run


OPERATOR, DOCK = "the operator", "the dock"  # who pauses a mission


class SavedMission(NamedTuple):
    """looked_from: poses in the map from which the camera has looked. blacklist: failed goals in the map, the remaining
    time in which they are not tried [s], and how often they failed. trail: the driven path, relative to the last pose
    of the base, oldest first. going_home: whether it was sent home. home: where the exploration began, in the map; None
    if not yet known. paused: whether the operator had paused it. elapsed_s, driven_m: of all sessions of a live run; 0
    in lock-step, whose journal tells them."""

    looked_from: list[SE2]
    blacklist: list[tuple[SE2, float, int]]
    trail: list[SE2]
    going_home: bool
    home: SE2 | None
    paused: bool = False
    elapsed_s: float = 0.0
    driven_m: float = 0.0

    def carried(self, since: Sequence[SE2]) -> SavedMission:
        """With a longer trail: the base has since been at these poses (at least one), relative to its last pose."""
        here = since[-1].inverse()
        return self._replace(trail=[here @ pose for pose in (*self.trail, *since)])

    def moved(self) -> SavedMission:
        """The same for a base that was moved: the trail is not behind it any more."""
        return self._replace(trail=[])

    def tree(self) -> dict[str, Any]:
        """As a tree for a file; ``of`` reads it back."""
        return {
            "looked_from": [pose.as_array().tolist() for pose in self.looked_from],
            "blacklist": [[*pose.as_array().tolist(), seconds, times] for pose, seconds, times in self.blacklist],
            "trail": [pose.as_array().tolist() for pose in self.trail],
            "going_home": self.going_home,
            "home": None if self.home is None else self.home.as_array().tolist(),
            "paused": self.paused,
            "elapsed_s": self.elapsed_s,
            "driven_m": self.driven_m,
        }

    @staticmethod
    def of(tree: Mapping[str, Any], path: Path) -> SavedMission:
        """Read a tree from this file. Raises InputError when this version or an earlier one did not write it."""
        try:
            blacklist = [_failure(row) for row in tree["blacklist" if "blacklist" in tree else "given_up"]]
            looked_from, trail = ([_pose(row) for row in tree[name]] for name in ("looked_from", "trail"))
            home = None if tree.get("home") is None else _pose(tree["home"])
            going_home, paused = bool(tree["going_home"]), bool(tree.get("paused"))
            elapsed_s, driven_m = (_amount(tree.get(name, 0.0)) for name in ("elapsed_s", "driven_m"))
            return SavedMission(
                looked_from, blacklist, trail, going_home=going_home, home=home, paused=paused, elapsed_s=elapsed_s,
                driven_m=driven_m,
            )  # fmt: skip
        except (KeyError, OverflowError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path} holds no memory of a mission ({error}); start a new run") from error


def _failure(row: Any) -> tuple[SE2, float, int]:
    *pose, seconds, times = row if len(row) == 5 else [*row, 1]  # older versions kept four, without the count
    if not 1 <= int(times) <= _MOST_TIMES:
        raise ValueError(f"{times} is no number of failures")
    return _pose(pose), _amount(seconds), int(times)


def _amount(value: Any) -> float:
    if not 0.0 <= float(value) <= _MOST:
        raise ValueError(f"{value} is neither a time nor a way of a run")
    return float(value)


def _pose(row: Any) -> SE2:
    x, y, theta = (float(value) for value in row)
    if not math.isfinite(x + y + theta):
        raise ValueError(f"pose {row} is not finite")
    return SE2(x, y, theta)
