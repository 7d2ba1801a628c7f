"""Motion planners by name: the protocol that all of them keep, and the registry that commands and nodes read."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.landmark_visibility import Visibility
from vsx_ros.planning.paper_planner import PaperPlanner
from vsx_ros.planning.path import Plan, Refusal
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.unconstrained import UnconstrainedPlanner
from vsx_ros.registry import Registry


class MotionPlanner(Protocol):
    """A way to a pose over known free ground."""

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """As ``Planner.plan``; one that knows nothing of the camera may leave ``visibility`` aside."""


PLANNERS: Registry[Callable[[PlannerConfig, RobotConfig], MotionPlanner]] = Registry(
    "planner", {"fov": Planner, "unconstrained": UnconstrainedPlanner, "paper": PaperPlanner}
)
"""fov: bounds the change of view; unconstrained: turns on the spot; paper: the letter of section 4, for comparison."""
