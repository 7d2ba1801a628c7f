"""Zones in which the robot stands because they were drawn around it, and the shortest way out."""

import math
from collections.abc import Callable

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.exploration.utility import TravelCosts, traversable_cells
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.keep_out import KeepOut
from vsx_ros.occupancy.zoned_grid import ZonedGrid

_STRIDE, _HEADINGS = 2, 16  # cells between places, and headings at each


class ZoneWatch:
    """Which closed zone a body of radius_m [m] would reach into, in the newest map."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._grid: OccupancyGrid | None = None

    def zone_at(self, grid: OccupancyGrid | None, pose: SE2 | None) -> str:
        """The zone's name; empty if there is none, or no map or pose."""
        if not isinstance(grid, ZonedGrid) or pose is None:
            return ""
        if grid is not self._grid:
            self._grid, self._keep_out = grid, KeepOut(grid, self._radius_m)
        return self._keep_out.zone_at(pose.x, pose.y)


def exit_pose(
    grid: ZonedGrid,
    T_map_base: SE2,
    radius_m: float,
    travel_costs: TravelCosts,
    failed: Callable[[FloatArray], BoolArray],
) -> SE2 | None:
    """The pose outside all zones with the shortest way from the base; None when none can be driven to.

    radius_m: of the body with its clearance. travel_costs: from the base, its own zone open. failed: which of poses
    (N, 3) are not to be tried. The other zones stay closed on the way."""
    room = np.argwhere(traversable_cells(grid, radius_m))
    room = room[(room % _STRIDE == 0).all(axis=1)]
    if not len(room):
        return None
    places = np.repeat(grid.centres(room), _HEADINGS, axis=0)
    headings = np.tile(T_map_base.theta + np.arange(_HEADINGS) * (2.0 * math.pi / _HEADINGS), len(room))
    poses = np.column_stack([places, headings])
    costs = travel_costs(poses)
    costs = np.where(failed(poses), math.inf, costs)
    best = int(np.argmin(costs))
    return SE2(*poses[best].tolist()) if math.isfinite(costs[best]) else None
