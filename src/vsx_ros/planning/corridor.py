"""What paths are checked against: where the base may go, which is the clearance field less what the base needs, for
finished paths and for a drive whose map has grown since; and what the camera would keep in view along them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField, least_on_curve
from vsx_ros.occupancy.distance import clearance_field, landmarks_in_view
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Path, Refusal, RefusalKind, Trajectory

# Searches check points, a centimetre stands for what is between; finished paths are checked so often.
_SEARCH_MARGIN_M, _CHECK_STEP_M = 0.01, 0.005
_GIVE_M, _GIVE_AHEAD_M = 0.02, 0.005  # less than the base has where it stands; of a drive that goes on, hardly any
_ESCAPE_M, _ESCAPE_SLOPE = 0.3, 2.0  # way to the full need again, and more of it per metre missing
_AHEAD_M, _LEFT_M = 1.5, 0.1  # of the way watched, several stops long; what is left before an obstacle
REVERSE_SLACK_M = 1e-6  # rounding
_VIEW_STEP_M = 0.1  # between places looked from; the view turns 0.2 rad over it at most (phi 2 rad/m)
_MOST_LANDMARKS = 1000  # a random or even part of more tells the same, in less time
_NEAREST_M = 0.3  # nearer ones leave the image at once
_SMALLER_HALF = 0.1  # of the least number: so many must be in each half of the view


@dataclass(frozen=True, slots=True, eq=False)
class Corridor:
    """The ground the base's centre may use.

    clearance: distance to ground not known to be free [m]. margin: that less the clearance the base needs there, less a
    centimetre for the gaps between checked points; searches stay where it is not negative."""

    clearance: DistanceField
    margin: DistanceField

    def least_margin(self, path: Path) -> float:
        """The least of clearance minus need over the path [m], a lower bound between its samples too."""
        return _least(self.margin, path) + _SEARCH_MARGIN_M - _CHECK_STEP_M

    def is_free(self, path: Path) -> bool:
        """Whether the base needs nowhere more room than there is."""
        return self.least_margin(path) >= 0.0

    def allows(self, path: Path, max_reverse_m: float) -> bool:
        """Whether the path is free, with no leg in reverse longer than so much [m]."""
        return path.longest_reverse_m <= max_reverse_m + REVERSE_SLACK_M and self.is_free(path)

    def measured(self, path: Path) -> Path:
        """The path with a lower bound of its clearance in its certificate."""
        clearance = _least(self.clearance, path) - 0.5 * _CHECK_STEP_M
        return replace(path, certificate=replace(path.certificate, min_clearance_m=clearance))


def _least(field: DistanceField, path: Path) -> float:
    """The field's least value on the path, looked at every ``_CHECK_STEP_M``."""
    at_start = float(field.at(np.array([[path.start.x, path.start.y]]))[0])
    return min([at_start, *(least_on_curve(field, p.table, p.direction, _CHECK_STEP_M) for p in path.pieces)])


def build_corridor(
    grid: OccupancyGrid, start: SE2, goal: SE2 | None, config: PlannerConfig, robot: RobotConfig
) -> Corridor | Refusal:
    """The corridor for a question; a start or goal the base cannot stand on is refused.

    The base needs its radius and config.clearance_m. Where it already stands closer it may leave, and where the goal
    lies closer (but not closer than the radius) it may arrive: near these two poses the need shrinks to what there is.
    """
    clearance = clearance_field(grid)
    need = robot.radius_m + config.clearance_m
    here = float(clearance.at(np.array([[start.x, start.y]]))[0])
    if here < 0.0:
        return Refusal(
            RefusalKind.START_BLOCKED,
            f"the start ({start.x:.2f}, {start.y:.2f}) lies {-here:.2f} m inside ground that is not known to be free",
        )
    needed = np.full(clearance.values.shape, need)
    _relax(needed, clearance, start, here, need)
    if goal is not None:
        there = float(clearance.at(np.array([[goal.x, goal.y]]))[0])
        if there < robot.radius_m:
            return Refusal(
                RefusalKind.GOAL_BLOCKED,
                f"the goal ({goal.x:.2f}, {goal.y:.2f}) has {there:.2f} m to ground that is not known to be free; "
                f"the base needs {robot.radius_m:.2f} m",
            )
        _relax(needed, clearance, goal, there, need)
    values = np.subtract(clearance.values, needed, out=needed)
    values -= _SEARCH_MARGIN_M
    margin = DistanceField(values, clearance.resolution, clearance.origin_x, clearance.origin_y)
    return Corridor(clearance, margin)


def _relax(needed: FloatArray, field: DistanceField, pose: SE2, clearance: float, need: float) -> None:
    """Lower the need around a pose that has less, rising again to the full need away from it (in place)."""
    have = clearance - _GIVE_M
    if have >= need:
        return
    escape = _ESCAPE_M + _ESCAPE_SLOPE * (need - have)
    x = field.origin_x + (np.arange(needed.shape[1]) + 0.5) * field.resolution - pose.x
    y = field.origin_y + (np.arange(needed.shape[0]) + 0.5) * field.resolution - pose.y
    # The ramp starts a cell away, so that interpolation cannot lift the need at the pose itself.
    away = np.maximum(np.hypot(x[None, :], y[:, None]) - math.sqrt(2.0) * field.resolution, 0.0)
    np.minimum(needed, have + (need - have) * away / escape, out=needed)


def obstacle_ahead(trajectory: Trajectory, from_s: float, grid: OccupancyGrid, radius_m: float) -> float | None:
    """How far the base (radius_m) may drive until it touches something, on the next 1.5 m of a trajectory [m]; None
    where it touches nothing.

    from_s: how far it has come on the trajectory, in its own time [s]. Only obstacles count: what is unknown again was
    free when the plan was made. Where the base stands closer already it may leave."""
    rest = trajectory.poses[trajectory.times_s - trajectory.times_s[0] >= from_s]
    positions = np.vstack([trajectory.at(from_s)[0].as_array()[None, :2], rest[:, :2]])
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    obstacles = replace(grid, data=np.where(grid.data == OCCUPIED, OCCUPIED, FREE))
    field = clearance_field(obstacles, 2.0 * radius_m)
    clearance_m = field.at(positions[way_m <= _AHEAD_M])
    touching = np.flatnonzero(clearance_m < min(radius_m, float(clearance_m[0])) - _GIVE_AHEAD_M)
    return float(way_m[touching[0]]) if len(touching) else None


def braking_before(obstacle_m: float, v_m_s: float, limits: LimitsConfig) -> float:
    """How hard to brake [m/s2] from a speed so that 10 cm are left before an obstacle so far ahead [m]: as gently as
    usual where that does, by a_stop_m_s2 where it does not; infinite where not even that does, and zero must be
    commanded at once.

    A jerk-limited stop from v takes v^2 / 2a + v a / 2j, and limits.reaction_s comes before it."""
    v = abs(v_m_s)
    room_m = obstacle_m - _LEFT_M - v * limits.reaction_s
    for a_m_s2 in (limits.a_m_s2, limits.a_stop_m_s2):
        braking = limits.braking(a_m_s2)
        if v * v / (2.0 * braking.a_m_s2) + v * braking.a_m_s2 / (2.0 * braking.jerk_m_s3) <= room_m:
            return a_m_s2
    return math.inf


class Visibility:
    """Known landmarks (M, 2 or 3) [m] and the camera that must see them.

    config.sight_landmarks are needed, and a tenth of that in either half of the picture (all on one side say little
    about the pose). Raises PlanningError for landmarks that are not finite."""

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
