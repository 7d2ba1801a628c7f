"""Whether the rest of a drive is still free on a map that has grown since it was planned."""

from __future__ import annotations

import numpy as np

from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Trajectory

_AHEAD_M = 1.5
_GIVE_M = 0.005


def obstacle_ahead(trajectory: Trajectory, from_s: float, grid: OccupancyGrid, radius_m: float) -> str:
    """What the base (radius_m) would touch on the next 1.5 m of a trajectory, in words; empty where nothing.

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
    return f"an obstacle has come to light {way_m[touching[0]]:.1f} m ahead on the way" if len(touching) else ""
