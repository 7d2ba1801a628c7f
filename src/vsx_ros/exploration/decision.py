"""The words between the mission and whoever drives: what is known, what to do, how it ended; a mission's log, and what
it keeps of an interrupted run, so that it goes on instead of beginning again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.slam.state import TrackingState

SECOND_NS = 1_000_000_000


class NavigationState(Enum):
    """What became of the last goal."""

    IDLE = "idle"
    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class Situation(NamedTuple):
    """What the mission knows when it decides.

    T_map_base is None while no map exists. hazard names a pressed bumper or the like. landmarks_world: (M, 3).
    odom_epoch: that of T_odom_base, which has nothing to do with one of another epoch.
    lifted: whether the robot is held in the air."""

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


class Action(Enum):
    """WAIT: go on as before. GO: a new goal. CANCEL: give up the goal and stand still. FINISH: the end."""

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


class Decision(NamedTuple):
    """One action; goal and frame ('map' or 'odom') only with GO."""

    action: Action
    goal: SE2 | None
    frame: str
    state: str
    reason: str


class MissionEvent(NamedTuple):
    """A change of state or a choice, for people."""

    stamp_ns: int
    state: str
    reason: str


class MissionLog:
    """Gives a mission's decisions and notes the choices among them. state: the box of the diagram the mission is in.
    outcome: how it ended, if it has. reason: of the last entry. wait_until_ns: when there is something to decide again.
    """

    def __init__(self) -> None:
        self.state = MissionState.STARTING
        self.outcome: Outcome | None = None
        self.reason = ""
        self.wait_until_ns = 0
        self._purpose = ""
        self._events: list[MissionEvent] = []

    def enter(self, now_ns: int, state: MissionState, reason: str) -> None:
        """From now on in this state."""
        self.state = state
        self.note(now_ns, reason)

    def note(self, now_ns: int, reason: str) -> None:
        """A choice."""
        self.reason = reason
        self._events.append(MissionEvent(now_ns, self.state.value, reason))

    def answer(self, action: Action, reason: str) -> Decision:
        """Anything but a new goal."""
        return Decision(action, goal=None, frame="map", state=self.state.value, reason=reason)

    def go(self, now_ns: int, goal: SE2, frame: str, reason: str) -> Decision:
        """A new goal."""
        self._purpose = reason
        self.note(now_ns, reason)
        return Decision(Action.GO, goal=goal, frame=frame, state=self.state.value, reason=reason)

    def on_the_way(self) -> Decision:
        """Leave whoever drives to the last goal alone."""
        return self.answer(Action.WAIT, f"on the way: {self._purpose}")

    def finish(self, now_ns: int, outcome: Outcome, reason: str) -> Decision:
        """The end; what ends later changes nothing."""
        if self.state is not MissionState.DONE:
            self.outcome = outcome
            self.enter(now_ns, MissionState.DONE, reason)
        return self.answer(Action.FINISH, self.reason)

    def drain(self) -> list[MissionEvent]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events


class SavedMission(NamedTuple):
    """looked_from: poses in the map the camera has looked from. blacklist: goals in the map that failed, for how long
    yet they are left alone [s], and how often they failed. trail: the way the base came, seen from where it stood last,
    oldest first. going_home: whether it was sent home. home: where the exploration began, in the map; None if that was
    not known yet. paused: whether the operator had it wait."""

    looked_from: list[SE2]
    blacklist: list[tuple[SE2, float, int]]
    trail: list[SE2]
    going_home: bool
    home: SE2 | None
    paused: bool = False

    def carried(self, since: Sequence[SE2]) -> SavedMission:
        """With a longer trail: the base has since stood at these poses, one at least, seen from where it stood last."""
        here = since[-1].inverse()
        return self._replace(trail=[here @ pose for pose in (*self.trail, *since)])

    def moved(self) -> SavedMission:
        """The same for a base that stands elsewhere by now: the way it came is not behind it."""
        return self._replace(trail=[])

    def tree(self) -> dict[str, Any]:
        """For a file; ``of`` reads it back."""
        return {
            "looked_from": [pose.as_array().tolist() for pose in self.looked_from],
            "blacklist": [[*pose.as_array().tolist(), seconds, times] for pose, seconds, times in self.blacklist],
            "trail": [pose.as_array().tolist() for pose in self.trail],
            "going_home": self.going_home,
            "home": None if self.home is None else self.home.as_array().tolist(),
            "paused": self.paused,
        }

    @staticmethod
    def of(tree: Mapping[str, Any], path: Path) -> SavedMission:
        """Raises InputError when the tree, of this file, is not one of ``tree``, of this version or one before."""
        try:
            blacklist = [_failure(row) for row in tree["blacklist" if "blacklist" in tree else "given_up"]]
            looked_from, trail = ([_pose(row) for row in tree[name]] for name in ("looked_from", "trail"))
            home = None if tree.get("home") is None else _pose(tree["home"])
            going_home, paused = bool(tree["going_home"]), bool(tree.get("paused"))
            return SavedMission(looked_from, blacklist, trail, going_home=going_home, home=home, paused=paused)
        except (KeyError, OverflowError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path} holds no memory of a mission ({error}); start a new run") from error


def _failure(row: Any) -> tuple[SE2, float, int]:
    *pose, seconds, times = row if len(row) == 5 else [*row, 1]  # older versions kept four, and not how often
    return _pose(pose), float(seconds), int(times)


def _pose(row: Any) -> SE2:
    x, y, theta = (float(value) for value in row)
    if not math.isfinite(x + y + theta):
        raise ValueError(f"pose {row} is not finite")
    return SE2(x, y, theta)
