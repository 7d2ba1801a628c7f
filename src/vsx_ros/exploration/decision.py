"""The words between the mission and whoever drives: what is known, what to do, how it ended."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.slam.state import TrackingState


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
    lifted: whether the robot is held in the air.
    """

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
