"""Other choices of the next goal, for comparison with ours: as explore_lite, by length of frontiers and straight
distance, and the first of a short tour over all frontiers."""

import math
from itertools import combinations

import numpy as np

from vsx_ros.exploration.utility import Ranker, Ranking, RankingInput, Rejection, View, rank_views, traversable_cells
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.unknown_ground import find_frontiers

POTENTIAL_SCALE, GAIN_SCALE = 3.0, 1.0  # explore_lite's defaults


def nearest_frontier(asked: RankingInput) -> Ranking:
    """explore_lite's ranking: 3 x straight distance to the frontier's nearest cell minus its length; the goal is the
    standing place nearest to its middle. explore_lite takes any heading; ours looks at the frontier."""
    return _ranked(asked)[0]


def frontier_tour(asked: RankingInput) -> Ranking:
    """The same goals in the order of a tour that begins here and ends anywhere: nearest neighbours, then 2-opt. Between
    goals it counts straight distances, from here the lengths of the ways, as FUEL does (Zhou et al., RA-L 2021)."""
    (views, rejected), lengths_m = _ranked(asked)
    if not views:
        return Ranking([], rejected)
    places = np.array([[view.pose.x, view.pose.y] for view in views])
    away_m = np.hypot(*np.moveaxis(places[:, None] - places[None], 2, 0))
    tour = [int(np.argmin(lengths_m))]
    while len(tour) < len(views):
        left = [k for k in range(len(views)) if k not in tour]
        tour.append(min(left, key=lambda k: away_m[tour[-1], k]))

    def length_m(order: list[int]) -> float:
        return float(lengths_m[order[0]] + away_m[order[:-1], order[1:]].sum())

    better = True
    while better:
        turned = [tour[:i] + tour[i:j][::-1] + tour[j:] for i, j in combinations(range(len(tour) + 1), 2)]
        best = min(turned, key=length_m)
        better = length_m(best) < length_m(tour) - 1e-9
        tour = best if better else tour
    return Ranking([views[k]._replace(utility=-float(rank)) for rank, k in enumerate(tour)], rejected)


def _ranked(asked: RankingInput) -> tuple[Ranking, np.ndarray]:
    """explore_lite's ranking, and the length of the way to each of its views [m]."""
    grid, radius_m, _, looked_from, travel_costs, blacklist, config = asked
    rejected = dict.fromkeys(Rejection, 0)
    cells = np.argwhere(traversable_cells(grid, radius_m + config.view_margin_m))
    frontiers = find_frontiers(grid, config.min_frontier_m)
    if not len(cells) or not frontiers:
        rejected[Rejection.NO_ROOM] = int(not len(cells))
        return Ranking([], rejected), np.zeros(0)
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
    lengths_m, failed = travel_costs(poses), blacklist(poses)
    reachable = np.isfinite(lengths_m)
    looked = np.array([_is_looked(pose, looked_from, config.look_spacing_m) for pose in poses])
    rejected[Rejection.BLACKLISTED], rejected[Rejection.LOOKED] = int(failed.sum()), int(looked.sum())
    rejected[Rejection.UNREACHABLE] = int((~reachable).sum())
    left = np.flatnonzero(~failed & reachable & ~looked)
    order = sorted(left.tolist(), key=lambda k: -views[k].utility)
    return Ranking([views[k] for k in order], rejected), lengths_m[order]


def _is_looked(pose: np.ndarray, looked_from: np.ndarray, spacing: float) -> bool:
    turn = (looked_from[:, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(((np.hypot(*(looked_from[:, :2] - pose[:2]).T) < spacing) & (np.abs(turn) < spacing)).any())


STRATEGIES: dict[str, Ranker] = {"views": rank_views, "nearest": nearest_frontier, "tour": frontier_tour}
