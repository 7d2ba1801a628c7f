"""The views worth their way, what each is to show, where the camera has looked from, and the goals that failed: these
are left alone for a while, longer each time, never for good while nothing else is left to do."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.config import Config, ExplorationConfig
from vsx_ros.exploration.decision import SECOND_NS
from vsx_ros.exploration.utility import RANKERS, Ranking, RankingInput, TravelCostsFrom, View, gain_at, near_poses
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.unknown_ground import Frontier, find_frontiers

_NEAR_RAD = 0.8  # a goal this like one that failed, within the base's radius, is the same one
_MOST_FAILURES = 3  # after so many a goal stays blacklisted
_MOST_DOUBLINGS = 7  # of blacklist_s: two hours, longer than a run
_MAPS_AGREE = 3  # So many maps in a row say that it has been seen: what is a wall to one may be a gap to the next


class ExpectedGain:
    """The unknown ground a view would show, judged by the looks until it was chosen; looks on the way there only tell
    from too far, and do not make it worth less."""

    def __init__(
        self, pose: SE2, grid: OccupancyGrid, radius_m: float, looked_from: FloatArray, config: ExplorationConfig
    ) -> None:
        self._gain: Callable[[OccupancyGrid], float] = lambda grid: gain_at(grid, radius_m, pose, looked_from, config)
        self._grid, self._gain_m2, self._maps_left = grid, self._gain(grid), _MAPS_AGREE
        self._seen_ratio = config.goal_seen_ratio

    def why_obsolete(self, grid: OccupancyGrid) -> str:
        """Why the goal is not worth going on to by this map; empty where it is, and for the map judged last."""
        if grid is self._grid:
            return ""
        self._grid = grid
        left = self._gain(grid)
        if left >= self._seen_ratio * self._gain_m2:
            self._maps_left = _MAPS_AGREE
            return ""
        self._maps_left -= 1
        if self._maps_left > 0:
            return ""
        return f"seen on the way: {left:.1f} of {self._gain_m2:.1f} m2 are left to see from the goal"


def pose_rows(poses: Sequence[SE2]) -> FloatArray:
    """(N, 3) x, y [m], theta [rad]."""
    return np.array([pose.as_array() for pose in poses]).reshape(-1, 3)


class ViewSelector:
    """``rank`` the views. looked_from: where the camera has looked from. blacklist: goals that failed. ranking: as
    found last."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        self._config, self._travel_costs = config.exploration, travel_costs
        self._rank = RANKERS[config.exploration.ranker]
        self._radius_m = config.robot.radius_m + config.planner.clearance_m
        self.looked_from: list[SE2] = []
        self.blacklist = GoalBlacklist(self._config.blacklist_radius_m, self._config.blacklist_s)
        self._grid: OccupancyGrid | None = None
        self.ranking = Ranking([], {})

    def look_from(self, T_map_base: SE2) -> None:
        """Remember the pose if it is far enough, in place or heading, from the last one."""
        last = self.looked_from[-1] if self.looked_from else None
        apart = math.inf if last is None else max(last.distance_to(T_map_base), abs(last.angle_to(T_map_base)))
        if apart > self._config.look_spacing_m:
            self.looked_from.append(T_map_base)

    def rank(self, now_ns: int, T_map_base: SE2, grid: OccupancyGrid, landmarks_world: FloatArray) -> Ranking:
        """What is worth its way from here, the best first, and what fell out for which reason."""
        self._grid = grid
        asked = RankingInput(
            grid=grid, radius_m=self._radius_m, landmarks_world=landmarks_world,
            looked_from=pose_rows(self.looked_from), travel_costs=self._travel_costs(T_map_base, grid),
            blacklist=lambda poses: self.blacklist.near(now_ns, poses), config=self._config,
        )  # fmt: skip
        self.ranking = self._rank(asked)
        return self.ranking

    def frontiers(self) -> list[Frontier]:
        """Where the known free ground of the map ranked last ends, for people to see."""
        return find_frontiers(self._grid, self._config.min_frontier_m) if self._grid is not None else []

    def expected_gain(self, view: View, grid: OccupancyGrid) -> ExpectedGain:
        """What the view is to show."""
        return ExpectedGain(view.pose, grid, self._radius_m, pose_rows(self.looked_from), self._config)


class _Failure(NamedTuple):
    """A goal, until when it is left alone and how often it has failed."""

    pose: SE2
    until_ns: int
    times: int


class GoalBlacklist:
    """Failed goals stand for all poses within radius_m [m]; the first failure counts for first_s [s]."""

    def __init__(self, radius_m: float, first_s: float) -> None:
        self._radius_m, self._first_s = radius_m, first_s
        self._failures: list[_Failure] = []

    def add(self, now_ns: int, pose: SE2) -> float:
        """Leave the goal alone from now on; for how long [s]: twice as long as the last time it failed, up to
        128 times as long as the first."""
        same = [f for f in self._failures if self._near(pose.as_array()[None], [f.pose])[0]]
        times = 1 + max((failure.times for failure in same), default=0)
        seconds = self._first_s * 2.0 ** min(times - 1, _MOST_DOUBLINGS)
        self._failures.append(_Failure(pose, now_ns + int(seconds * SECOND_NS), times))
        return seconds

    def near(self, now_ns: int, poses: FloatArray) -> BoolArray:
        """(N,) which of the poses (N, 3) are left alone now."""
        return self._near(poses, [failure.pose for failure in self._failures if failure.until_ns > now_ns])

    def _near(self, poses: FloatArray, failed: list[SE2]) -> BoolArray:
        return near_poses(poses, pose_rows(failed), self._radius_m, _NEAR_RAD)

    def release(self, now_ns: int) -> int:
        """Let what has not failed too often be tried again at once; how many goals that are."""
        kept = [f for f in self._failures if f.until_ns > now_ns and f.times < _MOST_FAILURES]
        self._failures = [f._replace(until_ns=now_ns) if f in kept else f for f in self._failures]
        return len(kept)

    def left(self, now_ns: int) -> list[tuple[SE2, float, int]]:
        """The goals that failed, for how long yet each is left alone [s] (0: no longer), and how often it failed."""
        return [(f.pose, max(f.until_ns - now_ns, 0) / SECOND_NS, f.times) for f in self._failures]

    def restore(self, now_ns: int, left: Sequence[tuple[SE2, float, int]]) -> None:
        """Take over what ``left`` said before an interruption."""
        self._failures = [_Failure(pose, now_ns + int(seconds * SECOND_NS), times) for pose, seconds, times in left]
