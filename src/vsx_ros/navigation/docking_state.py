"""What docking knows, is in, and does."""

from enum import Enum
from typing import NamedTuple

from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DockSight
from vsx_ros.robot import Odometry, VelocityCommand


class DockingState(Enum):
    """The boxes of the diagram in ``docking``."""

    IDLE = "idle"
    APPROACHING = "approaching"
    SEARCHING = "searching"
    ALIGNING = "aligning"
    CREEPING = "creeping"
    VERIFYING = "verifying"
    BACKING_OFF = "backing off"
    DOCKED = "docked"
    UNDOCKING = "undocking"
    UNDOCKED = "undocked"
    FAILED = "failed"

    @property
    def rests(self) -> bool:
        """Whether nothing is driven, and nothing will be."""
        return self in (DockingState.IDLE, DockingState.DOCKED, DockingState.UNDOCKED, DockingState.FAILED)

    @property
    def holds(self) -> bool:
        """Whether nobody else may move the base: docking itself does, or it charges, also while a contact flickers."""
        return self is DockingState.DOCKED or not (self.rests or self is DockingState.APPROACHING)


class DockingSeen(NamedTuple):
    """What is known. sight: None until the receivers were read again. charging: current flows, or the battery is full.
    hazard: what stops the base, e.g. a bumper; empty: nothing. navigation: how the goal of ``DockingAct`` fares. seat:
    where a docked base stands by now, in the map, which may have moved; None: where it was first."""

    odometry: Odometry
    sight: DockSight | None
    docked: bool
    charging: bool
    hazard: str
    T_map_base: SE2 | None
    navigation: NavigationState
    navigation_reason: str = ""
    seat: SE2 | None = None


class DockingAct(NamedTuple):
    """command: None: leave the wheels to navigation. goal: drive there, in the map; given once, and again when the dock
    has moved with the map."""

    command: VelocityCommand | None
    goal: SE2 | None = None
