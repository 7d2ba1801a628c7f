"""Two poses, free space: a path between them that never turns faster than phi per metre."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.planning import joint_qp
from vsx_ros.planning.path import Path, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import Piece
from vsx_ros.planning.words import free_space_sequences

TIGHTNESS = (1.0, 0.95, 0.9, 0.8)
"""Headings are searched at these shares of phi, so that the programme at phi has room."""

GOOD_ENOUGH = 1.004
_TRIES = 5
_SHORTEST_PIECE_M = 0.01
_CUSP_COST_M = 0.02
_EXACT = 1e-9


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


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Verdict of the closed form; margin_m: how far inside (positive) or outside the cone the goal lies."""

    ok: bool
    margin_m: float
    reason: str


def feasible(start: SE2, goal: SE2, phi: float, reverse: bool = False) -> Feasibility:
    """Whether one segment in one direction with monotone heading can join the poses: the paper's reach, exactly.

    Eq. (7)-(8) make the heading monotone and (11) forbids reversing, so the segment is the minimal arc
    E = (sin|d|, sign(d) (1 - cos d)) / phi plus a (1, 0) + b (cos d, sin d) with a, b >= 0 for the heading change d:
    the goal must lie in the cone of start and goal direction behind the arc. Raises PlanningError as ``connect``.
    """
    check_question(start, goal, phi)
    relative = start.inverse() @ goal
    x, y, d = relative.x, relative.y, wrap_angle(relative.theta)
    if reverse:  # the mirrored problem: x -> -x, theta -> -theta
        x, d = -x, -d
    way = "in reverse" if reverse else "forwards"
    sign = 1.0 if d >= 0.0 else -1.0
    gx = x - math.sin(abs(d)) / phi
    gy = sign * y - (1.0 - math.cos(d)) / phi
    angle = abs(d)
    if math.sin(angle) < 1e-9:
        ok = abs(gy) <= _EXACT and gx >= -_EXACT if angle < 1.0 else gy >= -_EXACT
        margin = -math.hypot(min(gx, 0.0), gy) if angle < 1.0 else gy
        words = "straight line" if angle < 1.0 else "half circle"
        return Feasibility(ok, 0.0 if ok and angle < 1.0 else margin, f"{words} {way}: off by {abs(margin):.3f} m")
    b = gy / math.sin(angle)
    a = gx - b * math.cos(angle)
    margin = min(a, b) * math.sin(angle)
    if min(a, b) >= -_EXACT:
        return Feasibility(True, margin, f"{math.degrees(angle):.1f} deg {way}, {margin:.3f} m inside the cone")
    which = "behind the arc along the start direction" if a < b else "short of the arc along the goal direction"
    return Feasibility(
        False,
        margin,
        f"a turn of {math.degrees(d):.1f} deg {way} at phi {phi:g} rad/m needs more room: "
        f"the goal lies {-margin:.3f} m outside the reachable cone ({which})",
    )


def connect(start: SE2, goal: SE2, phi: float, mode: str = "fov") -> Path | Refusal:
    """A path from start to goal with |dtheta/ds| <= phi everywhere, ending on the goal to a nanometre.

    mode: 'fov' the certified method, with cusps where they help; 'paper' the two-level optimisation of section 4,
    one segment without cusps, forward or reverse. Raises PlanningError for NaN, phi <= 0 or an unknown mode.
    """
    check_question(start, goal, phi)
    if same_pose(start, goal):
        return certified(start, goal, (), "start and goal are the same")
    if mode == "fov":
        candidates = connections(start, goal, phi, enough=1)
        if candidates:
            return candidates[0]
        return Refusal(RefusalKind.INFEASIBLE, "no heading sequence has a curve proved to keep the bound")
    if mode == "paper":
        from vsx_ros.planning.position_qp import connect_paper

        return connect_paper(start, goal, phi)
    raise PlanningError(f"unknown connection mode {mode!r}; use 'fov' or 'paper'")


def cost(path: Path) -> float:
    """Length with a small price on every stop to change direction [m]."""
    return path.length_m + _CUSP_COST_M * len(path.cusps)


def connections(start: SE2, goal: SE2, phi: float, enough: int) -> list[Path]:
    """Verified paths, cheapest first; searches on until ``enough`` were found and the first is near the optimum."""
    found: list[Path] = []
    optimum = free_space_sequences(start, goal, phi)[0].length_m
    for tight in TIGHTNESS:
        sequences = free_space_sequences(start, goal, tight * phi)
        long = [s for s in sequences if s.shortest_m >= _SHORTEST_PIECE_M or len(s.turns) == 1]
        for sequence in (long or sequences)[: max(_TRIES, enough)]:
            best = min((cost(path) for path in found), default=math.inf)
            if len(found) >= enough and tight * sequence.length_m >= best:
                break
            path = verified(start, goal, joint_qp.solve(sequence, start, goal, phi), phi)
            if path is not None:
                found.append(path)
        best = min((path.length_m for path in found), default=math.inf)
        if len(found) >= enough and best <= GOOD_ENOUGH * optimum:
            break
    return sorted(found, key=cost)


def verified(start: SE2, goal: SE2, pieces: tuple[Piece, ...] | None, phi: float) -> Path | None:
    """The path when an integration with another rule than the solver's confirms goal and bound, else None."""
    if pieces is None:
        return None
    path = certified(start, goal, pieces, "Bernstein coefficients")
    c = path.certificate
    sampled = max(float(abs(piece.table[:, 4]).max()) for piece in pieces)
    ok = c.curvature_bound_rad_m <= phi and sampled <= phi * (1.0 + _EXACT)
    return path if ok and c.end_error_m <= _EXACT and c.end_error_rad <= _EXACT else None
