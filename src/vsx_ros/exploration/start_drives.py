"""The drives that start a map (paper 3.1): a robot is put down anywhere, also before a wall or in a corner."""

import math

from vsx_ros.config import ExplorationConfig
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2

_TURN = SE2(0.0, 0.0, 0.5 * math.pi)  # a round body that turns on the spot touches nothing new


class StartDrives:
    """Straight ahead, then back; where neither shows enough, the same after a quarter turn on the spot, until all
    headings are tried."""

    def __init__(self, config: ExplorationConfig) -> None:
        self._ahead = SE2(config.init_drive_m, 0.0, 0.0)
        self._most = 3 * config.init_headings - 1
        self._given, self._is_out = 0, False

    def next(self, why: str) -> tuple[SE2, str] | None:
        """The next pose, relative to the base, and the reason; None when all are used up. why: what the last drive
        lacked."""
        if self._given == self._most:
            return None
        self._given, self._is_out = self._given + 1, True
        if self._given % 3 == 0:
            return _TURN, f"a quarter turn to see something else: {why}"
        drive = self._ahead if self._given % 3 == 1 else self._ahead.inverse()
        return drive, "first straight drive for two frames" if self._given == 1 else f"another straight drive: {why}"

    def interrupt(self, navigation: NavigationState) -> None:
        """Somebody else has the robot now: a last drive that was not driven to its end is given again."""
        if self._is_out and navigation is not NavigationState.SUCCEEDED:
            self._given, self._is_out = self._given - 1, False
