"""Whether the rest of a drive is still free on a map that has grown since it was planned, and how hard to brake where
it is not."""

import math

import numpy as np

from vsx_ros.config import LimitsConfig
from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Trajectory

_AHEAD_M = 1.5
_GIVE_M = 0.005
_LEFT_M = 0.1
_DEAD_TIME_S = 0.3  # a base's own 0.2 s, the follower's period, a message


def obstacle_ahead(trajectory: Trajectory, from_s: float, grid: OccupancyGrid, radius_m: float) -> float | None:
    """How far the base (radius_m) may drive until it touches something, on the next 1.5 m of a trajectory [m]; None
    where it touches nothing.

    from_s: how far it has come on the trajectory, in its own time [s]. Only obstacles count: what is unknown again was
    free when the plan was made. Where the base stands closer already it may leave.
    """
    rest = trajectory.poses[trajectory.times_s - trajectory.times_s[0] >= from_s]
    positions = np.vstack([trajectory.at(from_s)[0].as_array()[None, :2], rest[:, :2]])
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    obstacles = np.where(grid.data == OCCUPIED, OCCUPIED, FREE).astype(np.int8)
    field = clearance_field(OccupancyGrid(obstacles, grid.resolution, grid.origin_x, grid.origin_y), 2.0 * radius_m)
    clearance_m = field.at(positions[way_m <= _AHEAD_M])
    touching = np.flatnonzero(clearance_m < min(radius_m, float(clearance_m[0])) - _GIVE_M)
    return float(way_m[touching[0]]) if len(touching) else None


def braking_before(obstacle_m: float, v_m_s: float, limits: LimitsConfig) -> float:
    """How hard to brake [m/s2] from a speed so that 10 cm are left before an obstacle so far ahead [m]: as gently as
    usual where that does, by a_stop_m_s2 where it does not; infinite where not even that does, and zero must be
    commanded at once.

    A jerk-limited stop from v takes v^2 / 2a + v a / 2j, and the base's dead time comes before it.
    """
    v = abs(v_m_s)
    room_m = obstacle_m - _LEFT_M - v * _DEAD_TIME_S
    for a_m_s2 in (limits.a_m_s2, limits.a_stop_m_s2):
        braking = limits.braking(a_m_s2)
        if v * v / (2.0 * braking.a_m_s2) + v * braking.a_m_s2 / (2.0 * braking.jerk_m_s3) <= room_m:
            return a_m_s2
    return math.inf
