"""Two poses, free space: a path between them that never turns faster than phi per metre."""

import math

from vsx_ros.config import PlannerConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning import joint_qp
from vsx_ros.planning.coarse_path import nanometres, shortest_word
from vsx_ros.planning.joint_qp import free_space_sequences
from vsx_ros.planning.path import Path, certified

TIGHTNESS = (1.0, 0.95, 0.9, 0.8)
"""Headings are searched at these shares of phi, so that the programme at phi has room."""

GOOD_ENOUGH = 1.004  # times the shortest word's length: tighter headings can gain no more than that
_TRIES = 5  # sequences solved per tightness, for time
_SHORTEST_PIECE_M = 0.01  # shorter pieces make the programme ill-conditioned; used only where there are no others
_EXACT, _NOTHING_M = 1e-9, 1e-12  # m and rad: a goal counts as reached exactly; what rounding leaves of an arc
_USUAL = PlannerConfig()


def check_question(start: SE2, goal: SE2, phi: float) -> None:
    """Raise PlanningError for poses that are not finite or a phi that is not positive."""
    for name, pose in (("start", start), ("goal", goal)):
        if not pose.is_finite():
            raise PlanningError(f"{name} pose ({pose.x}, {pose.y}, {pose.theta}) is not finite; give three numbers")
    if not (math.isfinite(phi) and phi > 0.0):
        raise PlanningError(f"phi = {phi} rad/m: the bound on the change of view must be positive and finite")


def same_pose(start: SE2, goal: SE2) -> bool:
    """Whether nothing remains to be driven (to a nanometre and nanoradian)."""
    return start.distance_to(goal) <= _EXACT and abs(start.angle_to(goal)) <= _EXACT


def connect(start: SE2, goal: SE2, phi: float) -> Path:
    """A path from start to goal with |dtheta/ds| <= phi everywhere, ending on the goal to a nanometre, with cusps
    where they help. Raises PlanningError for NaN or phi <= 0."""
    check_question(start, goal, phi)
    if same_pose(start, goal):
        return certified(start, goal, (), "start and goal are the same")
    return connections(start, goal, phi, enough=1)[0]


def connections(start: SE2, goal: SE2, phi: float, enough: int, config: PlannerConfig = _USUAL) -> list[Path]:
    """Verified paths, cheapest by config first, never none; searches on until ``enough`` smooth ones are found.

    The shortest Reeds-Shepp word itself, arcs with stops between them, stands in where no smooth path comes near it
    (between poses a hair apart).
    """
    found: list[Path] = []
    arcs = tuple(arc for arc in shortest_word(start, goal, phi).arcs(start) if arc.length_m > _NOTHING_M)
    word = certified(start, goal, arcs, "arcs and lines")
    for tight in TIGHTNESS:
        sequences = free_space_sequences(start, goal, tight * phi, config.cusp_cost_m)
        long = [s for s in sequences if s.shortest_m >= _SHORTEST_PIECE_M or len(s.turns) == 1]
        for sequence in (long or sequences)[: max(_TRIES, enough)]:
            best = min((path.cost_m(config) for path in found), default=math.inf)
            if len(found) >= enough and tight * sequence.length_m + config.cusp_cost_m * sequence.cusps >= best:
                break
            path = joint_qp.solve(sequence, start, goal, phi)
            if path is not None:
                found.append(path)
        best = min((path.length_m for path in found), default=math.inf)
        if len(found) >= enough and best <= GOOD_ENOUGH * word.length_m:
            break
    return sorted([*found, word], key=lambda path: nanometres(path.cost_m(config)))
