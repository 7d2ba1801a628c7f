"""The generic planner of the paper's comparison: shortest grid path, turn on the spot, drive straight."""

import math

import numpy as np

from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning.motions import arc_is_free
from vsx_ros.occupancy.distance import travel_distance, with_fringe
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.corridor import Corridor, build_corridor
from vsx_ros.planning.feasibility import check_question
from vsx_ros.planning.landmark_visibility import Visibility
from vsx_ros.planning.path import Plan, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import Piece, arc_piece, turn_piece

_SMALLEST_TURN = 1e-9
_SMALLEST_DRIVE_M = 1e-9


class UnconstrainedPlanner:
    """What move_base users have: no bound on the change of view, the same robot and the same corridor."""

    def __init__(self, config: PlannerConfig, robot: RobotConfig) -> None:
        self._config = config
        self._robot = robot

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """As ``Planner.plan``, without ``visibility`` and rng. Raises PlanningError for poses that are not finite."""
        check_question(start, goal, self._config.phi_rad_m)
        corridor = build_corridor(grid, start, goal, self._config, self._robot)
        if isinstance(corridor, Refusal):
            return corridor
        points = _grid_way(start, goal, corridor)
        if points is None:
            return Refusal(
                RefusalKind.DISCONNECTED,
                f"no way over known free ground joins ({start.x:.2f}, {start.y:.2f}) and ({goal.x:.2f}, {goal.y:.2f})",
            )
        pieces = _turn_and_drive(start, goal, _in_sight(points, corridor))
        return Plan(goal, corridor.measured(certified(start, goal, pieces, "turns on the spot")), "unconstrained")


def _grid_way(start: SE2, goal: SE2, corridor: Corridor) -> list[tuple[float, float]] | None:
    """Points from start to goal down the travel distance; None where they are not joined."""
    field = corridor.margin
    distance = travel_distance(field, (goal.x, goal.y))
    i, j = field.cell(start.x, start.y)
    if not math.isfinite(with_fringe(distance, field.resolution)[i, j]):
        return None
    points = [(start.x, start.y)]
    while distance[i, j] > 0.0:
        a, b = max(i - 1, 0), max(j - 1, 0)
        window = distance[a : i + 2, b : j + 2]
        di, dj = np.unravel_index(int(np.argmin(window)), window.shape)
        i, j = a + int(di), b + int(dj)
        points.append((field.origin_x + (j + 0.5) * field.resolution, field.origin_y + (i + 0.5) * field.resolution))
    return [*points[:-1], (goal.x, goal.y)] if len(points) > 1 else [points[0], (goal.x, goal.y)]


def _in_sight(points: list[tuple[float, float]], corridor: Corridor) -> list[tuple[float, float]]:
    """The way with every point dropped that can be bypassed in a straight line."""
    field = corridor.margin
    kept = [points[0]]
    at = 0
    while at < len(points) - 1:
        x, y = points[at]
        ahead = len(points) - 1
        while ahead > at + 1:
            dx, dy = points[ahead][0] - x, points[ahead][1] - y
            theta, length = math.atan2(dy, dx), math.hypot(dx, dy)
            if arc_is_free(field, x, y, theta, 0.0, length):
                break
            ahead -= 1
        kept.append(points[ahead])
        at = ahead
    return kept


def _turn_and_drive(start: SE2, goal: SE2, points: list[tuple[float, float]]) -> tuple[Piece, ...]:
    pieces: list[Piece] = []
    at = start
    for x, y in points[1:]:
        length = math.hypot(x - at.x, y - at.y)
        if length < _SMALLEST_DRIVE_M:
            continue
        turn = wrap_angle(math.atan2(y - at.y, x - at.x) - at.theta)
        if abs(turn) > _SMALLEST_TURN:
            pieces.append(turn_piece(at, turn))
            at = pieces[-1].end
        pieces.append(arc_piece(at, 0.0, length, 1))
        at = pieces[-1].end
    turn = wrap_angle(goal.theta - at.theta)
    if abs(turn) > _SMALLEST_TURN:
        pieces.append(turn_piece(at, turn))
    return tuple(pieces)
