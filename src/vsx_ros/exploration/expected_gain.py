"""The gain a goal was chosen for: once most of it is seen on the way there, the rest of the way is not worth it."""

from __future__ import annotations

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ExplorationConfig
from vsx_ros.exploration.utility import gain_at
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid

_MAPS_AGREE = 3
"""So many maps in a row say that it has been seen: what is a wall to one may be a gap to the next."""


class ExpectedGain:
    """The unknown ground a view would show, judged by the looks until it was chosen; looks on the way there only tell
    from too far, and do not make it worth less."""

    def __init__(
        self, pose: SE2, grid: OccupancyGrid, radius_m: float, looked_from: FloatArray, config: ExplorationConfig
    ) -> None:
        self._pose, self._radius_m, self._looked_from, self._config = pose, radius_m, looked_from, config
        self._grid = grid
        self._gain_m2 = self._gain(grid)
        self._maps_left = _MAPS_AGREE

    def why_obsolete(self, grid: OccupancyGrid) -> str:
        """Why the goal is not worth going on to by this map; empty where it is, and for the map judged last."""
        if grid is self._grid:
            return ""
        self._grid = grid
        left = self._gain(grid)
        if left >= self._config.goal_seen_ratio * self._gain_m2:
            self._maps_left = _MAPS_AGREE
            return ""
        self._maps_left -= 1
        if self._maps_left > 0:
            return ""
        return f"seen on the way: {left:.1f} of {self._gain_m2:.1f} m2 are left to see from the goal"

    def _gain(self, grid: OccupancyGrid) -> float:
        return gain_at(grid, self._radius_m, self._pose, self._looked_from, self._config)
