"""Checks of paths. Where the base may go: the clearance field minus what the base needs, for finished paths and for a
drive whose map has grown since. And what the camera would keep in view along a path."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField, least_on_curve
from vsx_ros.occupancy.distance import clearance_field, landmarks_in_view, relax_need
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.keep_out import Entry, KeepOut
from vsx_ros.planning.path import Path, Refusal, RefusalKind, Trajectory
from vsx_ros.planning.retiming import stop_m

# Searches check single points, with a centimetre of margin for the gaps; finished paths are checked at this step.
_SEARCH_MARGIN_M, _CHECK_STEP_M = 0.01, 0.005
_GIVE_AHEAD_M = 0.005  # tolerance below the clearance while driving
_MAP_OFF_M = 0.02  # beside the body on its way, as the map may be so much off
_AHEAD_M, _LEFT_M = 1.5, 0.1  # length of path that is watched, several stops long; room left before an obstacle
REVERSE_SLACK_M = 1e-6  # rounding
_VIEW_STEP_M = 0.1  # between views along a path; the view turns at most 0.2 rad over it (phi 2 rad/m)
_MOST_LANDMARKS = 1000  # of more, a random or even sample gives the same result in less time
_NEAREST_M = 0.3  # nearer landmarks leave the image at once
_SMALLER_HALF = 0.1  # share of the least number that must be in each half of the view


@dataclass(frozen=True, slots=True, eq=False)
class Corridor:
    """The ground the base's centre may use.

    clearance: distance to ground not known to be free [m]. margin: that minus the clearance the base needs there, minus
    a centimetre for the gaps between checked points; searches stay where it is not negative."""

    clearance: DistanceField
    margin: DistanceField

    def least_margin(self, path: Path) -> float:
        """The smallest clearance minus need over the path [m]; a lower bound also between its samples."""
        return _least(self.margin, path) + _SEARCH_MARGIN_M - _CHECK_STEP_M

    def is_free(self, path: Path) -> bool:
        """Whether the base has enough room everywhere on the path."""
        return self.least_margin(path) >= 0.0

    def allows(self, path: Path, max_reverse_m: float) -> bool:
        """Whether the path is free and has no leg in reverse longer than max_reverse_m [m]."""
        return path.longest_reverse_m <= max_reverse_m + REVERSE_SLACK_M and self.is_free(path)

    def measured(self, path: Path) -> Path:
        """The path with a lower bound of its clearance in its certificate."""
        clearance = _least(self.clearance, path) - 0.5 * _CHECK_STEP_M
        return replace(path, certificate=replace(path.certificate, min_clearance_m=clearance))


def _least(field: DistanceField, path: Path) -> float:
    """The field's smallest value on the path, sampled every ``_CHECK_STEP_M``."""
    at_start = float(field.at(np.array([[path.start.x, path.start.y]]))[0])
    return min([at_start, *(least_on_curve(field, p.table, p.direction, _CHECK_STEP_M) for p in path.pieces)])


def build_corridor(
    grid: OccupancyGrid, start: SE2, goal: SE2 | None, config: PlannerConfig, robot: RobotConfig,
    clearance: DistanceField | None = None,
) -> Corridor | Refusal:  # fmt: skip
    """The corridor from start to goal; a start or goal where the base cannot stand is refused.

    clearance: that of another corridor in the same grid, to save time.

    The base needs its radius plus config.clearance_m. It may leave a start with less clearance, and reach a goal with
    less (but not less than the radius): near these two poses the need shrinks to the clearance there."""
    clearance = clearance_field(_drivable_part(grid)) if clearance is None else clearance
    need = robot.radius_m + config.clearance_m
    here = float(clearance.at(np.array([[start.x, start.y]]))[0])
    if here < 0.0 or not _is_in(grid, start):
        return Refusal(RefusalKind.START_BLOCKED, _why_blocked(grid, "start", start, here, robot.radius_m))
    needed = np.full(clearance.values.shape, need)
    relax_need(needed, clearance, start, need)
    if goal is not None:
        there = float(clearance.at(np.array([[goal.x, goal.y]]))[0])
        if there < robot.radius_m:
            return Refusal(RefusalKind.GOAL_BLOCKED, _why_blocked(grid, "goal", goal, there, robot.radius_m))
        relax_need(needed, clearance, goal, need)
    values = np.subtract(clearance.values, needed, out=needed)
    values -= _SEARCH_MARGIN_M
    margin = DistanceField(values, clearance.resolution, clearance.origin_x, clearance.origin_y)
    return Corridor(clearance, margin)


def _drivable_part(grid: OccupancyGrid) -> OccupancyGrid:
    """The smallest part of a map that holds all its drivable cells, the others closed; maps have wide empty borders."""
    drivable = grid.drivable
    rows, columns = (np.flatnonzero(drivable.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return grid
    box = drivable[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    x, y = (origin + cells[0] * grid.resolution for origin, cells in ((grid.origin_x, columns), (grid.origin_y, rows)))
    return OccupancyGrid(np.where(box, FREE, OCCUPIED), grid.resolution, x, y)


def _is_in(grid: OccupancyGrid, pose: SE2) -> bool:
    return bool(grid.contains(grid.cells(np.array([[pose.x, pose.y]])))[0])


def _why_blocked(grid: OccupancyGrid, name: str, pose: SE2, clearance_m: float, radius_m: float) -> str:
    at = f"the {name} ({pose.x:.2f}, {pose.y:.2f})"
    if not _is_in(grid, pose):
        return f"{at} lies outside the map"
    keep_out = KeepOut(grid, radius_m)
    zoned = float(keep_out.clearance(np.array([[pose.x, pose.y]]))[0]) < radius_m
    what = f"the zone {keep_out.zone_near(pose.x, pose.y)!r}" if zoned else "ground that is not known to be free"
    if clearance_m < 0.0:
        return f"{at} lies {-clearance_m:.2f} m inside {what}"
    has_m = math.floor(100.0 * clearance_m) / 100.0  # rounded down: it is less than what the base needs
    return f"{at} has {has_m:.2f} m to {what}; the base needs {radius_m:.2f} m"


def planned_clearance(trajectory: Trajectory, grid: OccupancyGrid, radius_m: float) -> FloatArray:
    """(N,) the clearances [m] of the samples of a trajectory from the obstacles in the map of its plan, as far as they
    matter to ``obstacle_ahead``; zones aside. What was unknown then may be an obstacle now, which is news."""
    positions = trajectory.poses[:, :2]
    low, high = positions.min(axis=0), positions.max(axis=0)
    x, y = (0.5 * (low + high)).tolist()
    near = grid.around(x, y, 0.5 * float(np.max(high - low)) + 2.0 * radius_m)
    return _field_around(near, near.data == OCCUPIED, radius_m).at(positions)


def obstacle_ahead(
    trajectory: Trajectory, from_s: float, grid: OccupancyGrid, radius_m: float, planned_m: FloatArray | None = None
) -> float | None:
    """How far the base (radius_m) can drive until it may touch something, on the next 1.5 m of a trajectory [m]; None
    when it touches nothing, even in a map that is 2 cm off.

    from_s: position on the trajectory, in its own time [s]. planned_m: its ``planned_clearance``; where the plan had
    little room, so little is not news. Only obstacles count: ground that is unknown again was free when the plan was
    made. A base that already stands closer to an obstacle may leave."""
    positions = _watched(trajectory, from_s)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    near = grid.around(float(positions[0, 0]), float(positions[0, 1]), _AHEAD_M + 2.0 * radius_m)
    clearance_m = _field_around(near, near.data == OCCUPIED, radius_m).at(positions)
    enough_m = np.full(len(positions), min(radius_m + _MAP_OFF_M, float(clearance_m[0])))
    if planned_m is not None:
        rest_m = planned_m[int(np.searchsorted(trajectory.times_s - trajectory.times_s[0], from_s)) :]
        enough_m[1:] = np.minimum(enough_m[1:], rest_m[: len(positions) - 1])
    touching = np.flatnonzero(clearance_m < enough_m - _GIVE_AHEAD_M)
    return float(way_m[touching[0]]) if len(touching) else None


def _field_around(grid: OccupancyGrid, closed: BoolArray, radius_m: float) -> DistanceField:
    """Distances to some cells (H, W) of a map, as far as they matter to a base on its way."""
    ground = np.where(closed, OCCUPIED, FREE).astype(np.int8)
    return clearance_field(OccupancyGrid(ground, grid.resolution, grid.origin_x, grid.origin_y), 2.0 * radius_m)


def _watched(trajectory: Trajectory, from_s: float) -> FloatArray:
    """(N, 2) the positions on the next 1.5 m of a trajectory, from a time on [s]."""
    rest = trajectory.poses[trajectory.times_s - trajectory.times_s[0] >= from_s]
    positions = np.vstack([trajectory.at(from_s)[0].as_array()[None, :2], rest[:, :2]])
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    return positions[way_m <= _AHEAD_M]


def zone_ahead(
    trajectory: Trajectory, from_s: float, grid: OccupancyGrid, radius_m: float, T_map_frame: SE2
) -> Entry | None:
    """Where the next 1.5 m of a trajectory enter a zone; None where they do not. T_map_frame: the trajectory's frame in
    the map."""
    return KeepOut(grid, radius_m).entered(T_map_frame @ _watched(trajectory, from_s))


def braking_before(obstacle_m: float, v_m_s: float, limits: LimitsConfig, way: Trajectory, at_s: float) -> float:
    """How hard to brake [m/s2] from v_m_s so that 10 cm are left before an obstacle obstacle_m ahead: a_m_s2 if that is
    enough, else a_stop_m_s2. Infinite if that is not enough either: then zero must be commanded at once.

    A jerk-limited stop from v takes v^2 / 2a + v a / 2j, and limits.reaction_s comes before it. Where the base speeds
    up or drives a bend, it takes longer: as much as a stop from the planned speed at at_s [s] on its way."""
    v = abs(v_m_s)
    room_m = obstacle_m - _LEFT_M - v * limits.reaction_s
    for a_m_s2 in (limits.a_m_s2, limits.a_stop_m_s2):
        braking = limits.braking(a_m_s2)
        longer_m = stop_m(way, at_s, braking) - _straight_stop_m(abs(way.at(at_s)[1]), braking)
        if _straight_stop_m(v, braking) + max(0.0, longer_m) <= room_m:
            return a_m_s2
    return math.inf


def _straight_stop_m(v: float, limits: LimitsConfig) -> float:
    return v * v / (2.0 * limits.a_m_s2) + v * limits.a_m_s2 / (2.0 * limits.jerk_m_s3)


class Visibility:
    """Known landmarks (M, 2 or 3) [m] and the camera that must see them.

    config.sight_landmarks are needed, and a tenth of that in each half of the image (all on one side determine the pose
    badly). Raises PlanningError for landmarks that are not finite."""

    def __init__(self, landmarks_world: FloatArray, config: PlannerConfig) -> None:
        if not np.all(np.isfinite(landmarks_world)):
            raise PlanningError("a landmark for planning is not finite; drop it before asking")
        self.landmarks_world, self.least = landmarks_world, config.sight_landmarks
        self._fov_rad, self._near_far_m = config.sight_fov_rad, (_NEAREST_M, config.sight_range_m)

    def blind(self, poses: FloatArray, grid: OccupancyGrid) -> BoolArray:
        """(N,) which of the poses (N, 3) would see too little."""
        half_fov_rad, landmarks, near_far_m = 0.25 * self._fov_rad, self.landmarks_world, self._near_far_m
        left, right = (
            landmarks_in_view(grid, poses + [0.0, 0.0, turn], landmarks, half_fov_rad, near_far_m, _MOST_LANDMARKS)
            for turn in (-half_fov_rad, half_fov_rad)
        )
        few = left + right < self.least
        return np.asarray(few | (np.minimum(left, right) < _SMALLER_HALF * self.least))

    def blind_spans(self, path: Path, grid: OccupancyGrid) -> FloatArray:
        """(K, 2) first and last arc length [m] of every stretch along which the camera would see too little."""
        rows = path.sample(_VIEW_STEP_M)
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
        blind = np.concatenate([[False], self.blind(rows[:, :3], grid)[1:], [False]])
        first, last = np.flatnonzero(blind[1:] & ~blind[:-1]), np.flatnonzero(~blind[1:] & blind[:-1])
        spans: FloatArray = np.stack([s[first], s[last]], axis=1)
        return spans[spans[:, 1] > spans[:, 0]]

    def blind_m(self, path: Path, grid: OccupancyGrid) -> float:
        """Length of the path along which the camera would see too little [m]."""
        return float(np.sum(np.diff(self.blind_spans(path, grid))))
