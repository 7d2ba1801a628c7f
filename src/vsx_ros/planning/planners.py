"""Motion planners by name, and the two of the paper's comparison. The paper's own planner (4.4): one optimised segment,
guided by motion primitives where that is not free. The generic one: shortest grid path, turn on the spot, drive
straight."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

import numpy as np

from vsx_ros.arrays import IntArray
from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning.motions import arc_is_free
from vsx_ros.kernels.planning.primitives import Grown, grow
from vsx_ros.occupancy.distance import travel_distance, with_fringe
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.corridor import Corridor, Visibility, build_corridor
from vsx_ros.planning.joint_qp import check_question, same_pose
from vsx_ros.planning.path import Path, Plan, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import Piece, arc_piece, turn_piece
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.two_level_qp import connect_paper
from vsx_ros.registry import Registry

_SMALLEST_TURN, _SMALLEST_DRIVE_M = 1e-9, 1e-9  # rad, m: less is rounding
_STATES = 4000  # at most in the tree
_ATTEMPTS = 20  # segments tried before it gives up
_STEP_RAD = 0.4  # turn along an edge at curvature phi
_METHOD = "motion primitives and dense samples of the two-level optimisation"


class MotionPlanner(Protocol):
    """Finds a path to a pose over known free ground."""

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """As ``Planner.plan``; a planner without a camera model may ignore ``visibility``."""


class _Compared(ABC):
    """Common base of both: the robot and its corridor."""

    def __init__(self, config: PlannerConfig, robot: RobotConfig) -> None:
        self._config, self._robot = config, robot

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """As ``Planner.plan``, without ``visibility``. Raises PlanningError for poses that are not finite."""
        check_question(start, goal, self._config.phi_rad_m)
        corridor = build_corridor(grid, start, goal, self._config, self._robot)
        return corridor if isinstance(corridor, Refusal) else self._within(start, goal, corridor, rng)

    @abstractmethod
    def _within(self, start: SE2, goal: SE2, corridor: Corridor, rng: np.random.Generator) -> Plan | Refusal:
        """The plan in a corridor."""


class UnconstrainedPlanner(_Compared):
    """As the planners of move_base: no bound on the change of view, but the same robot and the same corridor."""

    def _within(self, start: SE2, goal: SE2, corridor: Corridor, rng: np.random.Generator) -> Plan | Refusal:
        points = _grid_way(start, goal, corridor)
        if points is None:
            return Refusal(
                RefusalKind.DISCONNECTED,
                f"no way over known free ground joins ({start.x:.2f}, {start.y:.2f}) and ({goal.x:.2f}, {goal.y:.2f})",
            )
        pieces = _turn_and_drive(start, goal, _in_sight(points, corridor))
        return Plan(goal, corridor.measured(certified(start, goal, pieces, "turns on the spot")), "unconstrained")


def _grid_way(start: SE2, goal: SE2, corridor: Corridor) -> list[tuple[float, float]] | None:
    """Points from start to goal along falling travel distance; None when they are not connected."""
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
    """The path without the points that a straight line can bypass."""
    kept, at = points[:1], 0
    while at < len(points) - 1:
        at = next((k for k in range(len(points) - 1, at + 1, -1) if _sees(points[at], points[k], corridor)), at + 1)
        kept.append(points[at])
    return kept


def _sees(a: tuple[float, float], b: tuple[float, float], corridor: Corridor) -> bool:
    dx, dy = b[0] - a[0], b[1] - a[1]
    return arc_is_free(corridor.margin, *a, math.atan2(dy, dx), 0.0, math.hypot(dx, dy))


def _turn_and_drive(start: SE2, goal: SE2, points: list[tuple[float, float]]) -> tuple[Piece, ...]:
    pieces: list[Piece] = []
    at = start
    for x, y in points[1:]:
        length = math.hypot(x - at.x, y - at.y)
        if length >= _SMALLEST_DRIVE_M:
            turn = _turn(at, math.atan2(y - at.y, x - at.x))
            pieces += [*turn, arc_piece(turn[0].end if turn else at, 0.0, length, 1)]
            at = pieces[-1].end
    return (*pieces, *_turn(at, goal.theta))


def _turn(at: SE2, heading: float) -> list[Piece]:
    """The turn on the spot to a heading [rad]; empty if none is needed."""
    turn = wrap_angle(heading - at.theta)
    return [turn_piece(at, turn)] if abs(turn) > _SMALLEST_TURN else []


class PaperPlanner(_Compared):
    """For the comparison: no cusp within a segment, no shortcuts, curvature jumps between primitives."""

    def _within(self, start: SE2, goal: SE2, corridor: Corridor, rng: np.random.Generator) -> Plan | Refusal:
        phi = self._config.phi_rad_m
        if same_pose(start, goal):
            return Plan(goal, certified(start, goal, (), "start and goal are the same"), "paper")
        direct = connect_paper(start, goal, phi)
        if isinstance(direct, Path) and corridor.allows(direct, self._config.max_reverse_m):
            return Plan(goal, corridor.measured(certified(start, goal, direct.pieces, _METHOD)), "paper")
        reached = travel_distance(corridor.margin, (start.x, start.y))
        joined = with_fringe(reached, corridor.margin.resolution)
        if not math.isfinite(joined[corridor.margin.cell(goal.x, goal.y)]):
            return Refusal(RefusalKind.DISCONNECTED, "start and goal are not joined over known free ground")
        return self._guided(start, goal, corridor, np.flatnonzero(np.isfinite(reached)), rng)

    def _guided(
        self, start: SE2, goal: SE2, corridor: Corridor, cells: IntArray, rng: np.random.Generator
    ) -> Plan | Refusal:
        """Motion primitives to a suitable state, then the optimised segment to the goal."""
        phi, field = self._config.phi_rad_m, corridor.margin
        poses, parents = np.zeros((_STATES, 3)), np.full(_STATES, -1, np.int64)
        bends, signs, runs = np.zeros((3, _STATES))
        poses[0], tree = start.as_array(), Grown(poses, parents, bends=bends, signs=signs, runs=runs)
        state = np.array([rng.integers(1, 2**62)], np.uint64)
        size, step = 1, _STEP_RAD / phi
        for _ in range(_ATTEMPTS):
            size, candidate = grow(
                field, cells, goal.as_array(), phi, step, self._config.max_reverse_m, tree, size, state
            )
            if candidate < 0:
                break
            last = connect_paper(SE2(*poses[candidate].tolist()), goal, phi)
            if isinstance(last, Refusal) or not corridor.is_free(last):
                continue
            chain = []
            while candidate > 0:
                chain.append(candidate)
                candidate = int(parents[candidate])
            primitives: list[Piece] = []
            for k in reversed(chain):
                at, sign = primitives[-1].end if primitives else start, int(signs[k])
                primitives.append(arc_piece(at, float(bends[k]) * phi * sign, step, sign))
            path = certified(start, goal, (*primitives, *last.pieces), _METHOD)
            if corridor.allows(path, self._config.max_reverse_m):
                return Plan(goal, corridor.measured(path), "paper")
        return Refusal(
            RefusalKind.BUDGET, f"{size} states of motion primitives and no segment from them to the goal that is free"
        )


PLANNERS: Registry[Callable[[PlannerConfig, RobotConfig], MotionPlanner]] = Registry(
    "planner", {"fov": Planner, "unconstrained": UnconstrainedPlanner, "paper": PaperPlanner}
)
"""fov: bounds the change of view; unconstrained: turns on the spot; paper: exactly section 4, for comparison."""
