"""The views worth their way, what each is to show, the goals that failed, and where the camera has looked from."""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config, ExplorationConfig
from vsx_ros.exploration.frontiers import Frontier, find_frontiers
from vsx_ros.exploration.goal_blacklist import GoalBlacklist
from vsx_ros.exploration.utility import RANKERS, Ranking, RankingInput, TravelCostsFrom, View, gain_at
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid

_MAPS_AGREE = 3
"""So many maps in a row say that it has been seen: what is a wall to one may be a gap to the next."""


class ExpectedGain:
    """The unknown ground a view would show, judged by the looks until it was chosen; looks on the way there only tell
    from too far, and do not make it worth less."""

    def __init__(
        self, pose: SE2, grid: OccupancyGrid, radius_m: float, looked_from: FloatArray, config: ExplorationConfig
    ) -> None:
        self._pose, self._radius_m, self._looked_from, self._config = pose, radius_m, looked_from, config
        self._grid = grid
        self._gain_m2 = self._gain(grid)
        self._maps_left = _MAPS_AGREE

    def why_obsolete(self, grid: OccupancyGrid) -> str:
        """Why the goal is not worth going on to by this map; empty where it is, and for the map judged last."""
        if grid is self._grid:
            return ""
        self._grid = grid
        left = self._gain(grid)
        if left >= self._config.goal_seen_ratio * self._gain_m2:
            self._maps_left = _MAPS_AGREE
            return ""
        self._maps_left -= 1
        if self._maps_left > 0:
            return ""
        return f"seen on the way: {left:.1f} of {self._gain_m2:.1f} m2 are left to see from the goal"

    def _gain(self, grid: OccupancyGrid) -> float:
        return gain_at(grid, self._radius_m, self._pose, self._looked_from, self._config)


class ViewpointHistory:
    """A pose for every bit of way or turn, spacing [m and rad] apart, oldest first."""

    def __init__(self, spacing: float) -> None:
        self._spacing = spacing
        self.poses: list[SE2] = []

    def add(self, T_map_base: SE2) -> None:
        """Remember the pose if it is far enough from the last one."""
        last = self.poses[-1] if self.poses else None
        if (
            last is None
            or last.distance_to(T_map_base) > self._spacing
            or abs(last.angle_to(T_map_base)) > self._spacing
        ):
            self.poses.append(T_map_base)

    def as_array(self) -> FloatArray:
        """(N, 3) x, y [m], theta [rad]."""
        return np.array([pose.as_array() for pose in self.poses]).reshape(-1, 3)


class ViewSelector:
    """``rank`` the views anew. viewpoints: where the camera has looked from. blacklist: goals that failed. ranking: as
    found last."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        self._config, self._travel_costs = config.exploration, travel_costs
        self._rank = RANKERS[config.exploration.ranker]
        self._radius_m = config.robot.radius_m + config.planner.clearance_m
        self.viewpoints = ViewpointHistory(self._config.look_spacing_m)
        self.blacklist = GoalBlacklist(self._config.blacklist_radius_m, self._config.blacklist_s)
        self._grid: OccupancyGrid | None = None
        self.ranking = Ranking([], {})

    def rank(self, now_ns: int, T_map_base: SE2, grid: OccupancyGrid, landmarks_world: FloatArray) -> Ranking:
        """What is worth its way from here, the best first, and what fell out for which reason."""
        self._grid = grid
        asked = RankingInput(
            grid=grid,
            radius_m=self._radius_m,
            landmarks_world=landmarks_world,
            looked_from=self.viewpoints.as_array(),
            travel_costs=self._travel_costs(T_map_base, grid),
            blacklist=lambda poses: self.blacklist.near(now_ns, poses),
            config=self._config,
        )
        self.ranking = self._rank(asked)
        return self.ranking

    def frontiers(self) -> list[Frontier]:
        """Where the known free ground of the map ranked last ends, for people to see."""
        return find_frontiers(self._grid, self._config.min_frontier_m) if self._grid is not None else []

    def expected_gain(self, view: View, grid: OccupancyGrid) -> ExpectedGain:
        """What the view is to show."""
        return ExpectedGain(view.pose, grid, self._radius_m, self.viewpoints.as_array(), self._config)
