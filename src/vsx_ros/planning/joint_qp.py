"""A path between two poses in free space that never turns faster than phi per metre. It consists of a heading sequence
(driving direction and turn of each piece) and one quadratic programme for all pieces.

A Reeds-Shepp word gives the sequence for free space. Segments that bend to one side or are straight, without a change
of driving direction, form one piece, because the programme puts the straight length where it is best.

With theta(t) fixed in every piece, positions, length and the bound on the change of view are all linear in the
coefficients of rho_k = ds/dt >= 0 of all pieces jointly. Cusp positions are not chosen: the solution places them.

    minimise    sum_k  int rho_k dt  +  w int rho_k^2 dt          (length and a little energy)
    subject to  sum_k direction_k int rho_k (cos theta_k, sin theta_k) dt = goal position
                phi p_k(t) - |q_k(t)| >= phi floor  for all t       (flat_output.py)

DAQP (Arnstrom et al. 2022), a dual active-set method, solves it exactly."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import daqp
import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import PlannerConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning import curves as kernels
from vsx_ros.planning.coarse_path import CoarsePath, nanometres, shortest_word, words
from vsx_ros.planning.flat_output import COARSE, COEFFICIENTS, FLAGS, RATE_ROWS, Quadrature, curvature_bound, least_rate
from vsx_ros.planning.path import Path, certified
from vsx_ros.planning.pieces import Piece, curve_piece

_ITERATIONS = 1000  # of the solver, so that an ill-conditioned programme ends
_SHORTEST_SEGMENT = 1e-6  # rad at curvature phi; less is rounding
_ENERGY = 0.01  # weight of smoothness against length: small, so it decides only between paths of similar length
_FLOOR_M, _FLOOR_SHARE = 0.01, 0.02  # least length of a piece [m], and as a share of the path: none may vanish
_EXACT = 1e-9  # m, rad and share of phi: what counts as exact
LENGTH = {flags: COARSE.integral(COARSE.basis[flags]) for flags in FLAGS}
"""(10,) for every pair of end conditions: times the coefficients of rho gives a piece's length [m]."""
TIGHTNESS = (1.0, 0.95, 0.9, 0.8)  # Shares of phi for the sequences, so that the programme at phi has room

GOOD_ENOUGH = 1.004  # times the shortest word's length: lower tightness cannot gain more than that
_TRIES = 5  # sequences solved per tightness, to limit time
_SHORTEST_PIECE_M = 0.01  # shorter pieces make the programme ill-conditioned; used only if there are no others
_NOTHING_M = 1e-12  # shorter arcs are rounding
_USUAL = PlannerConfig()


class QpProblem(NamedTuple):
    """Minimise 1/2 x'P x + q'x subject to lower <= A x <= upper.

    P (n, n) symmetric positive definite, q (n,), A (m, n), lower and upper (m,), infinite where there is no bound."""

    P: FloatArray
    q: FloatArray
    A: FloatArray
    lower: FloatArray
    upper: FloatArray


class QpSolution(NamedTuple):
    """x (n,), and duals (m,) of the rows."""

    x: FloatArray
    duals: FloatArray


def solve_qp(problem: QpProblem, duals: FloatArray | None = None) -> QpSolution | None:
    """The solution, or None when DAQP reports none (infeasible, or the iteration limit).

    duals (m,): those of a similar problem; the search begins from its active rows. The solution is the same."""
    sense = np.where(problem.lower == problem.upper, 5, 0).astype(np.int32)
    x, _, flag, info = daqp.solve(
        problem.P, problem.q, np.ascontiguousarray(problem.A), np.minimum(problem.upper, 1e30),
        np.maximum(problem.lower, -1e30), sense, primal_tol=1e-9, iter_limit=_ITERATIONS, dual_start=duals,
    )  # fmt: skip
    x = np.array(x, float)
    return QpSolution(x, np.array(info["lam"], float)) if flag >= 1 and np.all(np.isfinite(x)) else None


@dataclass(frozen=True, slots=True)
class HeadingSequence:
    """One entry per piece: direction (+1, -1) and signed turn [rad]. joints[k]: whether the path continues from piece k
    to k + 1 without a stop. length_m: length of the word it comes from; shortest_m: of its shortest piece.
    members[k]: the segments of the word that piece k replaces. joined_ends: whether the sequence is a part of a longer
    path that comes to its start, and goes on from its end, without a stop."""

    directions: tuple[int, ...]
    turns: tuple[float, ...]
    joints: tuple[bool, ...]
    length_m: float
    shortest_m: float
    members: tuple[tuple[int, ...], ...]
    joined_ends: tuple[bool, bool] = (False, False)

    @property
    def cusps(self) -> int:
        """How often the driving direction changes."""
        return sum(not joint for joint in self.joints)

    def ends(self, k: int) -> tuple[bool, bool]:
        """Whether piece k is joined to the previous one and to the next one."""
        before, after = self.joined_ends
        return self.joints[k - 1] if k else before, self.joints[k] if k < len(self.joints) else after


def merge_segments(word: CoarsePath, total_turn: float, breaks: frozenset[int] = frozenset()) -> HeadingSequence | None:
    """The sequence of a word.

    The turns are adjusted to add up exactly to total_turn, modulo a full circle. A new piece always begins after a
    segment in breaks, which must be straight. None for a word without length."""
    turns, lengths = word.turns.tolist(), word.lengths.tolist()
    members: list[list[int]] = []
    for index in np.flatnonzero(np.abs(word.lengths) * word.phi >= _SHORTEST_SEGMENT).tolist():
        last = members[-1] if members else []
        goes_on = last and lengths[last[-1]] * lengths[index] > 0.0 and last[-1] not in breaks
        if goes_on and len({turns[i] for i in (*last, index)} - {0}) < 2:
            last.append(index)
        else:
            members.append([index])
    if not members:
        return None
    angles = [sum(turns[i] * lengths[i] * word.phi for i in piece) for piece in members]
    widest = int(np.argmax(np.abs(angles)))
    angles[widest] += wrap_angle(total_turn - sum(angles))
    sizes = [sum(abs(lengths[i]) for i in piece) for piece in members]
    directions = tuple(1 if lengths[piece[0]] > 0 else -1 for piece in members)
    joints = tuple(a == b for a, b in pairwise(directions))
    rows, length_m = tuple(map(tuple, members)), sum(sizes)
    return HeadingSequence(directions, tuple(angles), joints, length_m, shortest_m=min(sizes), members=rows)


def free_space_sequences(start: SE2, goal: SE2, phi: float, cusp_cost_m: float) -> list[HeadingSequence]:
    """The sequences of all Reeds-Shepp words between two poses at curvature phi [rad/m], cheapest first; a cusp counts
    as cusp_cost_m [m]."""
    turn = (start.inverse() @ goal).theta
    found = [merge_segments(word, turn) for word in words(start, goal, phi)]
    sequences = [sequence for sequence in found if sequence is not None]
    return sorted(sequences, key=lambda sequence: nanometres(sequence.length_m + cusp_cost_m * sequence.cusps))


def position_rows(sequence: HeadingSequence, theta: float, rule: Quadrature) -> FloatArray:
    """(2, I K, 10 K) rows that give x and y, relative to the start, at the ends of all intervals of the K pieces."""
    kinds = np.array([FLAGS.index(sequence.ends(k)) for k in range(len(sequence.turns))])
    turns = np.array(sequence.turns)
    heads = theta + np.concatenate([[0.0], np.cumsum(turns)[:-1]])
    return kernels.position_rows(
        kinds, heads, turns, np.array(sequence.directions), rule.every_basis, rule.every_profile, rule.weights,
        rule.order,
    )  # fmt: skip


def build(sequence: HeadingSequence, start: SE2, goal: SE2, phi: float) -> QpProblem:
    """The programme of a sequence between two poses; unknowns are the coefficients (10 K,)."""
    k = len(sequence.turns)
    rows = np.asarray(np.kron(np.eye(k), RATE_ROWS), np.float64)
    floor = min(_FLOOR_M, _FLOOR_SHARE * sequence.length_m)
    least = [least_rate(turn, phi, sequence.ends(i), floor) for i, turn in enumerate(sequence.turns)]
    target = np.array([goal.x - start.x, goal.y - start.y])
    return QpProblem(
        P=np.eye(COEFFICIENTS * k),
        q=np.concatenate([LENGTH[sequence.ends(i)] for i in range(k)]) * (0.5 * sequence.length_m / _ENERGY),
        A=np.concatenate([position_rows(sequence, start.theta, COARSE)[:, -1], rows]),
        lower=np.concatenate([target, *least]),
        upper=np.concatenate([target, np.full(len(rows), np.inf)]),
    )


def solve(sequence: HeadingSequence, start: SE2, goal: SE2, phi: float) -> Path | None:
    """The path, or None when the sequence has no solution with a proved bound."""
    problem = build(sequence, start, goal, phi)
    solution = solve_qp(problem)
    return None if solution is None else verified(problem, solution.x, sequence, start, goal, phi)


def verified(
    problem: QpProblem, x: FloatArray, sequence: HeadingSequence, start: SE2, goal: SE2, phi: float
) -> Path | None:
    """The path of coefficients (10 K,), or None unless each piece is proved to keep phi and an integration with another
    rule than the solver's confirms goal and bound."""
    # The solver meets equalities to 1e-9; put the end exactly on the goal with the smallest change.
    E, target = problem.A[:2], problem.lower[:2]
    x = x + np.linalg.lstsq(E, target - E @ x, rcond=None)[0]
    pieces: list[Piece] = []
    at = start
    for k, row in enumerate(x.reshape(-1, COEFFICIENTS)):
        joints = sequence.ends(k)
        bound = curvature_bound(row, sequence.turns[k], joints)
        if bound > phi:
            return None
        pieces.append(curve_piece(at, sequence.turns[k], sequence.directions[k], row, joints, bound))
        at = pieces[-1].end
    path = certified(start, goal, tuple(pieces), "Bernstein coefficients")
    sampled = max(float(abs(piece.table[:, 4]).max()) for piece in pieces)
    c = path.certificate
    ok = sampled <= phi * (1.0 + _EXACT) and c.end_error_m <= _EXACT and c.end_error_rad <= _EXACT
    return path if ok else None


def check_question(start: SE2, goal: SE2, phi: float) -> None:
    """Raise PlanningError for poses that are not finite or a phi that is not positive."""
    for name, pose in (("start", start), ("goal", goal)):
        if not pose.is_finite():
            raise PlanningError(f"{name} pose ({pose.x}, {pose.y}, {pose.theta}) is not finite; give three numbers")
    if not (math.isfinite(phi) and phi > 0.0):
        raise PlanningError(f"phi = {phi} rad/m: the bound on the change of view must be positive and finite")


def same_pose(start: SE2, goal: SE2) -> bool:
    """Whether both poses are equal (to a nanometre and nanoradian)."""
    return start.distance_to(goal) <= _EXACT and abs(start.angle_to(goal)) <= _EXACT


def connect(start: SE2, goal: SE2, phi: float) -> Path:
    """A path from start to goal with |dtheta/ds| <= phi everywhere, ending on the goal to a nanometre, with cusps
    where they help. Raises PlanningError for NaN or phi <= 0."""
    check_question(start, goal, phi)
    if same_pose(start, goal):
        return certified(start, goal, (), "start and goal are the same")
    return connections(start, goal, phi, enough=1)[0]


def connections(start: SE2, goal: SE2, phi: float, enough: int, config: PlannerConfig = _USUAL) -> list[Path]:
    """Verified paths, cheapest by config first, at least one; searches until ``enough`` smooth ones are found.

    The list includes the shortest Reeds-Shepp word itself, arcs with stops between them, for poses very close together
    that no smooth path joins well."""
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
            path = solve(sequence, start, goal, phi)
            if path is not None:
                found.append(path)
        best = min((path.length_m for path in found), default=math.inf)
        if len(found) >= enough and best <= GOOD_ENOUGH * word.length_m:
            break
    return sorted([*found, word], key=lambda path: nanometres(path.cost_m(config)))
