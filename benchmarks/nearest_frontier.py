"""Goals as explore_lite chooses them, by length of frontiers and straight distance, for comparison with ours."""

import math

import numpy as np

from vsx_ros.exploration.utility import Ranking, RankingInput, Rejection, View, traversable_cells
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.unknown_ground import find_frontiers

POTENTIAL_SCALE, GAIN_SCALE = 3.0, 1.0  # explore_lite's defaults


def nearest_frontier(asked: RankingInput) -> Ranking:
    """explore_lite's ranking: 3 x straight distance to the frontier's nearest cell minus its length; the goal is the
    standing place nearest to its middle. explore_lite takes any heading; ours looks at the frontier."""
    grid, radius_m, _, looked_from, travel_costs, blacklist, config = asked
    rejected = dict.fromkeys(Rejection, 0)
    cells = np.argwhere(traversable_cells(grid, radius_m + config.view_margin_m))
    frontiers = find_frontiers(grid, config.min_frontier_m)
    if not len(cells) or not frontiers:
        rejected[Rejection.NO_ROOM] = int(not len(cells))
        return Ranking([], rejected)
    places, here = grid.centres(cells), looked_from[-1, :2]
    views = []
    for frontier in frontiers:
        place = places[int(np.argmin(np.hypot(*(places - frontier.centroid).T)))]
        away = frontier.centroid - place
        heading = math.atan2(away[1], away[0])
        near_m = float(np.hypot(*(grid.centres(frontier.cells) - here).T).min())
        utility = GAIN_SCALE * frontier.length_m - POTENTIAL_SCALE * near_m
        views.append(View(SE2(*map(float, place), heading), frontier.length_m, near_m, 0, utility))
    poses = np.array([view.pose.as_array() for view in views])
    failed, reachable = blacklist(poses), np.isfinite(travel_costs(poses))
    looked = np.array([_is_looked(pose, looked_from, config.look_spacing_m) for pose in poses])
    rejected[Rejection.BLACKLISTED], rejected[Rejection.LOOKED] = int(failed.sum()), int(looked.sum())
    rejected[Rejection.UNREACHABLE] = int((~reachable).sum())
    left = [view for view, out in zip(views, failed | ~reachable | looked, strict=True) if not out]
    return Ranking(sorted(left, key=lambda view: -view.utility), rejected)


def _is_looked(pose: np.ndarray, looked_from: np.ndarray, spacing: float) -> bool:
    turn = (looked_from[:, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(((np.hypot(*(looked_from[:, :2] - pose[:2]).T) < spacing) & (np.abs(turn) < spacing)).any())
