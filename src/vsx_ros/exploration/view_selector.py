"""The views worth their way, the blacklist of goals that failed, and where the camera has looked from."""

from __future__ import annotations

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.exploration.expected_gain import ExpectedGain
from vsx_ros.exploration.frontiers import Frontier, find_frontiers
from vsx_ros.exploration.goal_blacklist import GoalBlacklist
from vsx_ros.exploration.utility import RANKERS, Ranking, RankingInput, TravelCostsFrom, View
from vsx_ros.exploration.viewpoint_history import ViewpointHistory
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid


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
