"""What the newest map and zones show on the rest of a way that is being driven."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zoned_grid import ZonedGrid, speed_limits
from vsx_ros.planning.corridor import obstacle_ahead, zone_ahead
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import MAP_FRAME
from vsx_ros.slam.state import TrackingState

_FASTER_M_S = 0.01  # rounding of times
_AGAIN_S = 1.0  # obstacles are looked for some way ahead only, so a way is judged again after driving on for so long


class Hindrance(NamedTuple):
    """Why a way is not driven to its end. ahead_m: so far ahead [m]; None: brake at the usual rate."""

    ahead_m: float | None
    reason: str


class WayWatch:
    """Judges a way for each new map, and again every second of the drive. Ways in odom are driven over ground that was
    driven before, so that obstacles do not count there; zones do."""

    def __init__(self, config: Config) -> None:
        self._radius_m = config.robot.radius_m
        self._checked: OccupancyGrid | None = None
        self._checked_s = 0.0
        self._drawn: int | None = None
        self._planned_m: FloatArray | None = None

    def begin(self, grid: OccupancyGrid | None, clearance_m: FloatArray | None) -> None:
        """Another way is driven. grid: the map when its plan was asked for; zones may have been drawn since.
        clearance_m: (N,) ``planned_clearance`` of its samples; None: enough."""
        self._checked, self._drawn, self._planned_m = None, _drawing(grid), clearance_m

    def hindrance(
        self, trajectory: Trajectory, frame: str, at_s: float, grid: OccupancyGrid, where: LocalizationState
    ) -> Hindrance | None:
        """What is new on the rest of the way, from at_s [s] on; None when nothing is, for what was judged already, and
        as long as the frame's place in the map is not known."""
        T_map_frame = frame_in_map(frame, where)
        judged = grid is self._checked and at_s < self._checked_s + _AGAIN_S
        if judged or T_map_frame is None:
            return None
        self._checked, self._checked_s = grid, at_s
        found = [(math.inf, "")]
        if frame == MAP_FRAME:
            obstacle_m = obstacle_ahead(trajectory, at_s, grid, self._radius_m, self._planned_m)
            if obstacle_m is not None:
                found.append((obstacle_m, f"an obstacle has come to light {obstacle_m:.1f} m ahead on the way"))
        zone = zone_ahead(trajectory, at_s, grid, self._radius_m, T_map_frame)
        if zone is not None:
            found.append((zone.ahead_m, f"the zone {zone.zone!r} lies {zone.ahead_m:.1f} m ahead on the way"))
        nearest_m, reason = min(found)
        if math.isfinite(nearest_m):
            return Hindrance(nearest_m, reason)
        if self._is_too_fast(trajectory, at_s, grid, T_map_frame):
            return Hindrance(None, "a slow zone was drawn on the way")
        return None

    def _is_too_fast(self, trajectory: Trajectory, from_s: float, grid: OccupancyGrid, T_map_frame: SE2) -> bool:
        """Whether the rest of the way is faster than a zone allows that was drawn after the plan. A zone that only
        moves with the map, by centimetres, makes no new plan."""
        if _drawing(grid) == self._drawn:
            return False
        self._drawn = _drawing(grid)
        rest = trajectory.times_s - trajectory.times_s[0] >= from_s
        limits = speed_limits(grid, T_map_frame @ trajectory.poses[rest, :2])
        return bool(np.any(np.abs(trajectory.v[rest]) > limits + _FASTER_M_S))


def frame_in_map(frame: str, where: LocalizationState) -> SE2 | None:
    """T_map_frame for the frames map and odom; None while unknown. A new map begins as the odometry frame."""
    if frame == MAP_FRAME:
        return SE2()
    T_frame_base = where.pose(frame)
    if T_frame_base is None:
        return None
    if where.T_map_base is None:
        return SE2() if where.slam_state is TrackingState.NOT_INITIALISED else None
    return where.T_map_base @ T_frame_base.inverse()


def _drawing(grid: OccupancyGrid | None) -> int | None:
    """The version of the zones drawn on a map; None without zones."""
    return grid.zones.version if isinstance(grid, ZonedGrid) else None
