"""A mission driven by hand: what it is told, and one that already maps."""

import numpy as np

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.slam.state import TrackingState

SECOND = 1_000_000_000
LANDMARKS = np.random.default_rng(0).uniform([1.0, -2.0, 0.0], [3.0, 2.0, 1.0], (800, 3))


def half_known() -> OccupancyGrid:
    """Free for x < 1.5 m, unknown beyond."""
    data = np.full((80, 120), UNKNOWN, np.int8)
    data[:, :60] = FREE
    return OccupancyGrid(data, 0.05, -1.5, -2.0)


def euclid(start, grid, clearance_m, poses):
    return np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)


def situation(**changes) -> Situation:
    default = Situation(TrackingState.GOOD, "", SE2(), SE2(), half_known(), NavigationState.IDLE, "", None, LANDMARKS)
    return default._replace(**changes)


def mapping_mission() -> Mission:
    mission = Mission(Config(), euclid)
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    assert mission.decide(SECOND, situation()).action is Action.GO
    assert mission.state is MissionState.MAPPING
    return mission


def wheels_driven(mission: Mission, way_m: float, start: SE2) -> SE2:
    """A drive straight ahead, in steps of 5 cm; where the wheels are then."""
    pose = start
    for k in range(round(way_m / 0.05) + 1):
        pose = start @ SE2(0.05 * k, 0.0, 0.0)
        mission.decide(2 * SECOND + k, situation(T_odom_base=pose, navigation=NavigationState.ACTIVE))
    return pose
