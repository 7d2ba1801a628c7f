"""The views worth their drive, what each should show, from where the camera has looked, and the failed goals. A failed
goal is not tried for a while, longer each time; if nothing else is left, it is tried again."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config import Config, ExplorationConfig
from vsx_ros.exploration.decision import SECOND_NS
from vsx_ros.exploration.time_left import TimeLeft, left_to_see
from vsx_ros.exploration.utility import (
    RANKERS,
    Ranking,
    RankingInput,
    TravelCostsFrom,
    View,
    count_landmarks,
    gain_at,
    near_poses,
)
from vsx_ros.exploration.zone_exit import exit_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import KINECT_RAD, with_view
from vsx_ros.occupancy.anchored_poses import MapCorrections
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.unknown_ground import WALL_ROW_M, Frontier, find_frontiers
from vsx_ros.occupancy.zoned_grid import ZonedGrid

_NEAR_RAD = 0.8  # a goal this close in heading to a failed one, within the radius, counts as the same
_STANDS_M, _MOST_WIDENINGS = 0.1, 3  # a robot that moved less chooses from the same place; of the radius: to 3.2 m
_EXIT_RADIUS_M = 0.15  # the next exit of a zone may be beside the one that failed
_MOST_FAILURES = 3  # after so many a goal stays blacklisted
_MOST_DOUBLINGS = 7  # of blacklist_s: two hours, longer than a run
_MAPS_AGREE = 3  # So many maps in a row must show it as seen: a wall in one map may be a gap in the next


class ExpectedGain:
    """The unknown ground that a view would show, given the looks before it was chosen. Looks on the way there are from
    too far and do not count."""

    def __init__(
        self, pose: SE2, grid: OccupancyGrid, radius_m: float, looked_from: FloatArray, config: ExplorationConfig
    ) -> None:
        reach_m = config.sensor_range_m + WALL_ROW_M

        def gain(grid: OccupancyGrid) -> float:
            return gain_at(grid.around(pose.x, pose.y, reach_m), radius_m, pose, looked_from, config)

        self._gain: Callable[[OccupancyGrid], float] = gain
        self._grid, self._gain_m2, self._maps_left = grid, self._gain(grid), _MAPS_AGREE
        self._seen_ratio = config.goal_seen_ratio

    def why_obsolete(self, grid: OccupancyGrid) -> str:
        """Why the goal is not worth the drive any more in this map; empty if it is, and for the map judged last."""
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
    """Ranks the views. looked_from: poses from which the camera has looked. blacklist: failed goals. ranking: the last
    one. time_left: of the exploration, as far as it is known."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        self._given, self._travel_costs = config, travel_costs
        self.look_with(KINECT_RAD)
        self._rank = RANKERS[config.exploration.ranker]
        self._clearances_m = config.planner.medium_clearance_m, config.planner.clearance_m
        self._body_m, self._least_m = config.robot.radius_m, config.robot.radius_m + config.planner.clearance_m
        self.looked_from: list[SE2] = []
        self.blacklist = GoalBlacklist(self._config.blacklist_radius_m, self._config.blacklist_s)
        self._exits = GoalBlacklist(_EXIT_RADIUS_M, self._config.blacklist_s)
        self._grid: OccupancyGrid | None = None
        self.ranking, self.time_left = Ranking([], {}), TimeLeft()

    def look_with(self, fov_rad: float) -> None:
        """The camera has this field of view [rad]; the configuration may have another."""
        self._config = with_view(self._given, fov_rad).exploration

    def look_from(self, T_map_base: SE2) -> None:
        """Remember the pose if it is far enough, in place or heading, from the last one."""
        last = self.looked_from[-1] if self.looked_from else None
        apart = math.inf if last is None else max(last.distance_to(T_map_base), abs(last.angle_to(T_map_base)))
        if apart > self._config.look_spacing_m:
            self.looked_from.append(T_map_base)

    def moved(self, corrections: MapCorrections) -> None:
        """The map was corrected, and with it moves what is remembered."""
        self.looked_from = corrections.moved(self.looked_from)
        self.blacklist.moved(corrections)
        self._exits.moved(corrections)

    def rank(self, now_ns: int, T_map_base: SE2, grid: OccupancyGrid, landmarks_world: FloatArray) -> Ranking:
        """The views worth the drive from here, best first, and the rejected candidates for each reason. Those behind
        narrow gaps count only when no other has enough landmarks in view: most gaps are wider when more is known."""
        self._grid, best = grid, Ranking([], {})
        self.blacklist.choose_at(T_map_base)
        for clearance_m in self._clearances_m:
            asked = RankingInput(
                grid=grid, radius_m=self._body_m + clearance_m, landmarks_world=landmarks_world,
                looked_from=pose_rows(self.looked_from),
                travel_costs=partial(self._travel_costs, T_map_base, grid, clearance_m),
                blacklist=lambda poses: self.blacklist.near(now_ns, poses), config=self._config,
            )  # fmt: skip
            ranking = self._rank(asked)
            is_safe = any(view.landmarks >= self._config.min_landmarks for view in ranking.views)
            best = ranking if is_safe or not best.views else best
            if is_safe:
                break
        self.ranking = best
        self.time_left.add(now_ns, grid.known_area_m2, left_to_see(best.views, self._config.sensor_range_m))
        return best

    def count_landmarks(self, grid: OccupancyGrid, poses: FloatArray, landmarks_world: FloatArray) -> IntArray:
        """(N,) known landmarks that each pose (N, 3) would have in view."""
        return count_landmarks(grid, poses, landmarks_world, self._config)

    def frontiers(self) -> list[Frontier]:
        """Where the known free ground ends in the last ranked map, for display."""
        return find_frontiers(self._grid, self._config.min_frontier_m) if self._grid is not None else []

    def exit_pose(self, now_ns: int, grid: OccupancyGrid, T_map_base: SE2) -> SE2 | None:
        """The pose outside all zones with the shortest way from here, away from exits that failed; None when there is
        none, then failed ones may be tried again."""
        if not isinstance(grid, ZonedGrid):
            return None
        self._exits.choose_at(T_map_base)
        opened, failed = grid.opened_at(T_map_base.x, T_map_base.y), lambda poses: self._exits.near(now_ns, poses)
        costs = partial(self._travel_costs, T_map_base, opened, self._clearances_m[-1])
        found = exit_pose(grid, T_map_base, self._least_m, costs, failed)
        if found is None:
            self._exits.release(now_ns)
        return found

    def exit_failed(self, now_ns: int, pose: SE2) -> None:
        """The way to this pose outside a zone could not be driven."""
        self._exits.add(now_ns, pose)

    def withdraw(self, since_ns: int) -> None:
        """Forget failures of goals and exits since then."""
        self.blacklist.withdraw(since_ns)
        self._exits.withdraw(since_ns)

    def expected_gain(self, view: View, grid: OccupancyGrid) -> ExpectedGain:
        """What the view should show."""
        return ExpectedGain(view.pose, grid, self._least_m, pose_rows(self.looked_from), self._config)


class _Failure(NamedTuple):
    """A goal, until when it is not tried, how often it has failed, and the last time of that."""

    pose: SE2
    until_ns: int
    times: int
    at_ns: int


class GoalBlacklist:
    """A failed goal counts for all poses within radius_m [m]; the first failure lasts first_s [s]. Goals that fail one
    after another while the robot stands may have one cause, such as a door. So their radius grows until it moves."""

    def __init__(self, radius_m: float, first_s: float) -> None:
        self._radius_m, self._first_s = radius_m, first_s
        self._failures: list[_Failure] = []
        self._place: SE2 | None = None
        self._failed_here: list[SE2] = []  # since the last release
        self._times_here = self._releases_here = 0

    def choose_at(self, T_map_base: SE2) -> None:
        """Where the robot is when it chooses a goal."""
        if self._place is None or self._place.distance_to(T_map_base) > _STANDS_M:
            self._place = T_map_base
            self._forget_here()

    def add(self, now_ns: int, pose: SE2) -> float:
        """Blacklist the goal from now on. Returns for how long [s]: twice as long as for its last failure, up to 128
        times the first."""
        same = self._near(pose_rows([failure.pose for failure in self._failures]), [pose])
        times = 1 + max((failure.times for failure, is_same in zip(self._failures, same) if is_same), default=0)
        seconds = self._first_s * 2.0 ** min(times - 1, _MOST_DOUBLINGS)
        self._failures.append(_Failure(pose, now_ns + int(seconds * SECOND_NS), times, now_ns))
        if self._place is not None:
            self._failed_here.append(pose)
            self._times_here += 1
        return seconds

    def withdraw(self, since_ns: int) -> None:
        """Forget failures since then: they were nobody's fault."""
        self._failures = [failure for failure in self._failures if failure.at_ns < since_ns]
        self._forget_here()

    def moved(self, corrections: MapCorrections) -> None:
        """The map was corrected."""
        poses = corrections.moved([failure.pose for failure in self._failures])
        self._failures = [failure._replace(pose=pose) for failure, pose in zip(self._failures, poses, strict=True)]
        self._failed_here = corrections.moved(self._failed_here)
        self._place = corrections.moved([self._place])[0] if self._place is not None else None

    def _forget_here(self) -> None:
        self._failed_here, self._times_here, self._releases_here = [], 0, 0

    def near(self, now_ns: int, poses: FloatArray) -> BoolArray:
        """(N,) which of the poses (N, 3) are blacklisted now."""
        near = self._near(poses, [failure.pose for failure in self._failures if failure.until_ns > now_ns])
        if (again := self._times_here - 2) >= 0:
            wide_m = self._radius_m * 2.0 ** min(again, _MOST_WIDENINGS)
            near |= near_poses(poses, pose_rows(self._failed_here), wide_m, math.inf)
        return near

    def _near(self, poses: FloatArray, failed: list[SE2]) -> BoolArray:
        return near_poses(poses, pose_rows(failed), self._radius_m, _NEAR_RAD)

    def release(self, now_ns: int) -> int:
        """Allow goals that have not failed too often to be tried again at once, and those that never failed but lie
        near failed ones; both at most twice where the robot stands. Returns how many failures count for less."""
        freed: list[SE2] = []
        if self._releases_here < _MOST_FAILURES - 1:
            freed, self._failed_here = self._failed_here if self._times_here > 1 else [], []
            self._releases_here += self._times_here > 0
        kept = [
            f for f in self._failures
            if f.until_ns > now_ns and f.times < _MOST_FAILURES and f.pose not in self._failed_here
        ]  # fmt: skip
        self._failures = [f._replace(until_ns=now_ns) if f in kept else f for f in self._failures]
        return max(len(kept), len(freed))

    def left(self, now_ns: int) -> list[tuple[SE2, float, int]]:
        """The failed goals, the remaining blacklist time of each [s] (0: none), and how often it failed."""
        return [(f.pose, max(f.until_ns - now_ns, 0) / SECOND_NS, f.times) for f in self._failures]

    def restore(self, now_ns: int, left: Sequence[tuple[SE2, float, int]]) -> None:
        """Take over what ``left`` returned before an interruption."""
        self._failures = [_Failure(pose, now_ns + int(seconds * SECOND_NS), times, -1) for pose, seconds, times in left]
