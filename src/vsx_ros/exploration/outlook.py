"""What there is to look at: the views worth their way, and which of those are left alone for now."""

from __future__ import annotations

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.exploration.frontiers import Frontier, find_frontiers
from vsx_ros.exploration.given_up import GivenUp
from vsx_ros.exploration.looks import Looks
from vsx_ros.exploration.promise import Promise
from vsx_ros.exploration.utility import RANKERS, Ranking, RankingInput, TravelCostsFrom, View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid


class Outlook:
    """``rank`` the views anew. looks: where the camera has looked from. given_up: goals that failed. ranking: as found
    last."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        self._config, self._travel_costs = config.exploration, travel_costs
        self._rank = RANKERS[config.exploration.ranker]
        self._radius_m = config.robot.radius_m + config.planner.clearance_m
        self.looks = Looks(self._config.look_spacing_m)
        self.given_up = GivenUp(self._config.blacklist_radius_m, self._config.blacklist_s)
        self._grid: OccupancyGrid | None = None
        self.ranking = Ranking([], {})

    def rank(self, now_ns: int, T_map_base: SE2, grid: OccupancyGrid, landmarks_world: FloatArray) -> Ranking:
        """What is worth its way from here, the best first, and what fell out for which reason."""
        self._grid = grid
        asked = RankingInput(
            grid=grid,
            radius_m=self._radius_m,
            landmarks_world=landmarks_world,
            looked_from=self.looks.as_array(),
            travel_costs=self._travel_costs(T_map_base, grid),
            given_up=lambda poses: self.given_up.near(now_ns, poses),
            config=self._config,
        )
        self.ranking = self._rank(asked)
        return self.ranking

    def frontiers(self) -> list[Frontier]:
        """Where the known free ground of the map ranked last ends, for people to see."""
        return find_frontiers(self._grid, self._config.min_frontier_m) if self._grid is not None else []

    def promise(self, view: View, grid: OccupancyGrid) -> Promise:
        """What the view is to show."""
        return Promise(view.pose, grid, self._radius_m, self.looks.as_array(), self._config)
