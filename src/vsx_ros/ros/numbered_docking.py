"""A docking may begin and end between two looks at it; so each has a number, and its end is told once."""

import time

from vsx_ros.config import DockingConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.docking import Docking


class NumberedDocking(Docking):
    """number: of the newest docking or undocking. It differs from all before, also from those of a node that ended: it
    begins with the clock [ms]."""

    def __init__(self, config: DockingConfig, seed: int) -> None:
        super().__init__(config, seed)
        self.number, self._is_open = time.time_ns() // 1_000_000, False

    def dock(self, now_ns: int, kind: str, T_map_dock: SE2) -> None:
        """Raises ConfigError as the base class."""
        super().dock(now_ns, kind, T_map_dock)
        self._count()

    def undock(self, now_ns: int, turn_rad: float = 0.0) -> None:
        """As the base class."""
        super().undock(now_ns, turn_rad)
        self._count()

    def _count(self) -> None:
        self.number, self._is_open = self.number + 1, True

    def has_ended(self) -> bool:
        """Whether a docking or undocking has ended since the last call; true once for each, or for several that follow
        at once."""
        ended, self._is_open = self._is_open and self.state.rests, not self.state.rests
        return ended
