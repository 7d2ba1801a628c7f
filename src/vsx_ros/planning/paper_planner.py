"""The paper's whole planner (4.4): one optimised segment, guided by motion primitives where that leaves the map."""

import math

import numpy as np

from vsx_ros.arrays import IntArray
from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.planning.primitives import Grown, grow
from vsx_ros.occupancy.distance import travel_distance, with_fringe
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.connect import check_question, same_pose
from vsx_ros.planning.corridor import Corridor, build_corridor
from vsx_ros.planning.landmark_visibility import Visibility
from vsx_ros.planning.path import Path, Plan, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import Piece, arc_piece
from vsx_ros.planning.two_level_qp import connect_paper

_STATES = 4000  # most of one tree; then another one is grown
_ATTEMPTS = 20  # trees, before it gives up
_STEP_RAD = 0.4  # turn along an edge at curvature phi
_METHOD = "motion primitives and dense samples of the two-level optimisation"


class PaperPlanner:
    """For the comparison: no cusp within a segment, no shortcuts, curvature jumps between primitives."""

    def __init__(self, config: PlannerConfig, robot: RobotConfig) -> None:
        self._config = config
        self._robot = robot

    def plan(
        self, start: SE2, goal: SE2, grid: OccupancyGrid, rng: np.random.Generator, visibility: Visibility | None = None
    ) -> Plan | Refusal:
        """As ``Planner.plan``, without ``visibility``. Raises PlanningError for poses that are not finite."""
        phi = self._config.phi_rad_m
        check_question(start, goal, phi)
        corridor = build_corridor(grid, start, goal, self._config, self._robot)
        if isinstance(corridor, Refusal):
            return corridor
        if same_pose(start, goal):
            return Plan(goal, certified(start, goal, (), "start and goal are the same"), "paper")
        direct = connect_paper(start, goal, phi)
        if isinstance(direct, Path) and corridor.allows(direct, self._config.max_reverse_m):
            return Plan(goal, corridor.measured(certified(start, goal, direct.pieces, _METHOD)), "paper")
        reached = travel_distance(corridor.margin, (start.x, start.y))
        joined = with_fringe(reached, grid.resolution)
        if not math.isfinite(joined[corridor.margin.cell(goal.x, goal.y)]):
            return Refusal(RefusalKind.DISCONNECTED, "start and goal are not joined over known free ground")
        return self._guided(start, goal, corridor, np.flatnonzero(np.isfinite(reached)), rng)

    def _guided(
        self, start: SE2, goal: SE2, corridor: Corridor, cells: IntArray, rng: np.random.Generator
    ) -> Plan | Refusal:
        """Primitives to a favourable state, then the optimised segment to the goal."""
        phi, field = self._config.phi_rad_m, corridor.margin
        poses, parents = np.zeros((_STATES, 3)), np.full(_STATES, -1, np.int64)
        bends, signs, runs = np.zeros((3, _STATES))
        poses[0], tree = start.as_array(), Grown(poses, parents, bends, signs, runs)
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
