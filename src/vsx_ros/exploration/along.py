"""What the camera sees on the way to a view: ways that show more on their length are worth more (pathwise gain, as in
arXiv 2503.07504)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import ExplorationConfig
from vsx_ros.exploration.utility import Ranking, Rejection, View
from vsx_ros.exploration.worth import opaque_walls, unknown_worth
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.visibility import UNKNOWN, count_looks
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Refusal
from vsx_ros.planning.planner import Planner

_WAY_STEP_M = 0.3
_WAYS = 6
_APART_M, _APART_RAD = 0.8, 0.8

WayTo = Callable[[SE2], FloatArray | None]
"""A goal to the poses (N, 3) of the way there; None where there is none."""

WaysFrom = Callable[[SE2, OccupancyGrid], WayTo]
"""Start pose and grid to the function that plans ways."""


def ways_of(planner: Planner) -> WaysFrom:
    """Ways as the planner plans them."""

    def ways_from(start: SE2, grid: OccupancyGrid) -> WayTo:
        def way_to(goal: SE2) -> FloatArray | None:
            plan = planner.plan(start, goal, grid, np.random.default_rng(0))
            return None if isinstance(plan, Refusal) else plan.path.sample(_WAY_STEP_M)[:, :3]

        return way_to

    return ways_from


def with_ways(
    ranking: Ranking,
    way_to: WayTo,
    grid: OccupancyGrid,
    radius_m: float,
    looked_from: FloatArray,
    config: ExplorationConfig,
) -> Ranking:
    """The ranking with the best few views, apart from each other, judged by their planned ways: v is what the view
    shows and config.way_gain_ratio of what only the way shows, d the way's length. Those without a way fall out.
    Arguments as of ``rank_views``."""
    opaque = opaque_walls(grid, 2.0 * radius_m, config.wall_gap_m)
    worth = unknown_worth(opaque, looked_from, config)
    rejected, judged, rest = dict(ranking.rejected), list[View](), list[View]()
    planned = list[SE2]()
    for view in ranking.views:
        if len(planned) == _WAYS or any(_alike(view.pose, other) for other in planned):
            rest.append(view)
            continue
        planned.append(view.pose)
        way = way_to(view.pose)
        if way is None:
            rejected[Rejection.UNREACHABLE] += 1
            continue
        judged.append(_judged(view, way, opaque, worth, config))
    return Ranking(sorted(judged, key=lambda view: -view.utility) + rest, rejected)


def _alike(a: SE2, b: SE2) -> bool:
    return a.distance_to(b) < _APART_M and abs(a.angle_to(b)) < _APART_RAD


def _judged(view: View, way: FloatArray, opaque: OccupancyGrid, worth: FloatArray, config: ExplorationConfig) -> View:
    poses = np.vstack([way, view.pose.as_array()])
    shown_m2, own_m2 = (unknown_area_along(seen_from, opaque, worth, config) for seen_from in (poses, poses[-1:]))
    gain_m2 = own_m2 + config.way_gain_ratio * (shown_m2 - own_m2)
    length_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    doubts = view.utility * (view.distance_m + config.stop_cost_m) / max(view.gain_m2, 1e-9)
    utility = doubts * gain_m2 / (length_m + config.stop_cost_m)
    return view._replace(gain_m2=float(gain_m2), distance_m=length_m, utility=utility)


def unknown_area_along(poses: FloatArray, opaque: OccupancyGrid, worth: FloatArray, config: ExplorationConfig) -> float:
    """Area [m2] of the unknown cells that are in the field of view of any of the poses (N, 3: x, y, theta), in range
    and unhidden, each once, weighted by its greatest worth (S, H, W) among the sectors that it is seen in."""
    looks = count_looks(
        opaque.data, opaque.resolution, opaque.origin_x, opaque.origin_y, poses, 0.5 * config.sensor_fov_rad,
        config.sensor_range_m, len(worth),
    )  # fmt: skip
    best = np.where(looks > 0, worth, 0.0).max(axis=0)
    return float(best[opaque.data == UNKNOWN].sum()) * opaque.resolution**2
