"""Compiled code is loaded (or, the first time, compiled) before a node says that it is ready, never in a callback."""

from __future__ import annotations

import numpy as np

from vsx_ros.config import Config
from vsx_ros.exploration.mission import Mission, NavigationState, Situation
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.planning.path import Plan
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.slam.state import TrackingState

_CELLS = 100
_RESOLUTION_M = 0.05


def _small_room() -> OccupancyGrid:
    """5 m x 5 m, a pillar in the middle, unknown beyond one side."""
    data = np.zeros((_CELLS, _CELLS), np.int8)
    data[45:55, 45:55] = OCCUPIED
    data[:, 90:] = UNKNOWN
    return OccupancyGrid(data, _RESOLUTION_M, 0.0, 0.0)


def warm_up_planning(planner: Planner, config: Config) -> None:
    """Plan once around a pillar, once blindly, and put time on both."""
    start, goal = SE2(1.0, 2.5, 0.0), SE2(4.0, 2.6, 0.3)
    plans = planner.plan(start, goal, _small_room(), np.random.default_rng(0)), planner.plan_blind(start, goal)
    for plan in plans:
        if isinstance(plan, Plan):
            time_scale(plan.path, config.limits)


def warm_up_mission(mission: Mission) -> None:
    """Let a mission that is thrown away choose a view once."""
    landmarks = np.random.default_rng(0).uniform(0.0, 5.0, (200, 3))
    pose = SE2(1.0, 2.5, 0.0)
    mission.decide(
        0,
        Situation(
            TrackingState.GOOD, "", pose, pose, _small_room(), NavigationState.IDLE, "", None, landmarks
        ),  # fmt: skip
    )
