"""What computing costs in lock-step: emulated time, from counted work, so that the same seed gives the same bits."""

import numpy as np

from vsx_ros.config import ComputingConfig
from vsx_ros.navigation.goal_planner import TimedPlan
from vsx_ros.occupancy.grid import UNKNOWN, OccupancyGrid
from vsx_ros.planning.path import Refusal


class ComputingTime:
    """Durations in ns of one frame, one ranking of views and one plan."""

    def __init__(self, config: ComputingConfig) -> None:
        self._config = config

    def frame_ns(self) -> int:
        """From a frame's stamp to its pose being known."""
        return _ns(self._config.frame_ms)

    def ranking_ns(self, grid: OccupancyGrid) -> int:
        """To rank the views that a map offers."""
        return _ns(self._config.ranking_ms + self._config.ranking_ms_m2 * known_m2(grid))

    def plan_ns(self, answer: TimedPlan | Refusal) -> int:
        """To find a way, or that there is none, and its speeds."""
        way_m = answer.plan.path.length_m if isinstance(answer, TimedPlan) else 0.0
        return _ns(self._config.plan_ms + self._config.plan_ms_m * way_m)


def known_m2(grid: OccupancyGrid) -> float:
    """Ground of a map that is known [m2]."""
    return float(np.count_nonzero(grid.data != UNKNOWN)) * grid.resolution**2


def _ns(milliseconds: float) -> int:
    return round(1e6 * milliseconds)
