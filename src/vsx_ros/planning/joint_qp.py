"""Heading sequences, which way to drive and how far to turn piece by piece, and one quadratic programme for all pieces.

A Reeds-Shepp word tells the sequence for free space. Where the word bends one way, straight or not, without changing
direction, one piece suffices, because the programme puts the straight length where it is best.

With theta(t) fixed in every piece, positions, length and the bound on the change of view are all linear in the
coefficients of rho_k = ds/dt >= 0 of all pieces jointly. Cusp positions are not chosen: the solution places them.

    minimise    sum_k  int rho_k dt  +  w int rho_k^2 dt          (length and a little energy)
    subject to  sum_k direction_k int rho_k (cos theta_k, sin theta_k) dt = goal position
                phi p_k(t) - |q_k(t)| >= phi floor  for all t       (fov_bound.py)
"""

from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning import curves as kernels
from vsx_ros.planning.coarse_path import CoarsePath, nanometres, words
from vsx_ros.planning.flat_output import COARSE, COEFFICIENTS, FLAGS, Quadrature
from vsx_ros.planning.fov_bound import RATE_ROWS, curvature_bound, least_rate
from vsx_ros.planning.path import CUSP_COST_M, Path, certified
from vsx_ros.planning.pieces import Piece, curve_piece
from vsx_ros.planning.qp import QpProblem, solve_qp

_SHORTEST_SEGMENT = 1e-6
_ENERGY = 0.01
_FLOOR_M = 0.01
_FLOOR_SHARE = 0.02
_EXACT = 1e-9
_LENGTH = {flags: COARSE.integral(COARSE.basis[flags]) for flags in FLAGS}


@dataclass(frozen=True, slots=True)
class HeadingSequence:
    """One entry a piece: direction (+1, -1) and signed turn [rad]; joints[k] tells whether the path runs on
    without stopping from piece k to k + 1. length_m: of the word it comes from; shortest_m: of its shortest piece.
    members[k]: which segments of the word piece k replaces.
    """

    directions: tuple[int, ...]
    turns: tuple[float, ...]
    joints: tuple[bool, ...]
    length_m: float
    shortest_m: float
    members: tuple[tuple[int, ...], ...]

    @property
    def cusps(self) -> int:
        """How often the driving direction changes."""
        return sum(not joint for joint in self.joints)

    def ends(self, k: int) -> tuple[bool, bool]:
        """Whether piece k is joined to the one before and to the one after."""
        return k > 0 and self.joints[k - 1], k < len(self.joints) and self.joints[k]


def merge_segments(word: CoarsePath, total_turn: float, breaks: frozenset[int] = frozenset()) -> HeadingSequence | None:
    """The sequence of a word.

    The headings are made to add up to total_turn modulo a full circle exactly. After a segment in breaks, which must be
    straight, a new piece begins in any case. None for a word without length.
    """
    directions: list[int] = []
    bends: list[int] = []
    angles: list[float] = []
    sizes: list[float] = []
    joints: list[bool] = []
    members: list[list[int]] = []
    for index, (bend, length) in enumerate(zip(word.turns.tolist(), word.lengths.tolist())):
        if abs(length) * word.phi < _SHORTEST_SEGMENT:
            continue
        direction = 1 if length > 0 else -1
        same = bool(directions) and directions[-1] == direction
        if same and members[-1][-1] not in breaks and (bend == 0 or bends[-1] in (0, bend)):
            bends[-1] = bends[-1] or bend
            angles[-1] += bend * length * word.phi
            sizes[-1] += abs(length)
            members[-1].append(index)
            continue
        if directions:
            joints.append(same)
        directions.append(direction)
        bends.append(bend)
        angles.append(bend * length * word.phi)
        sizes.append(abs(length))
        members.append([index])
    if not directions:
        return None
    widest = int(np.argmax(np.abs(angles)))
    angles[widest] += wrap_angle(total_turn - sum(angles))
    return HeadingSequence(
        tuple(directions), tuple(angles), tuple(joints), sum(sizes), min(sizes), tuple(map(tuple, members))
    )


def free_space_sequences(start: SE2, goal: SE2, phi: float) -> list[HeadingSequence]:
    """The sequences of all Reeds-Shepp words between two poses at curvature phi [rad/m], cheapest first."""
    turn = (start.inverse() @ goal).theta
    found = [merge_segments(word, turn) for word in words(start, goal, phi)]
    sequences = [sequence for sequence in found if sequence is not None]
    return sorted(sequences, key=lambda sequence: nanometres(sequence.length_m + CUSP_COST_M * sequence.cusps))


def position_rows(sequence: HeadingSequence, theta: float, rule: Quadrature) -> FloatArray:
    """(2, I K, 10 K) rows that give x and y, relative to the start, at the ends of all intervals of the K pieces."""
    kinds = np.array([FLAGS.index(sequence.ends(k)) for k in range(len(sequence.turns))])
    turns = np.array(sequence.turns)
    heads = theta + np.concatenate([[0.0], np.cumsum(turns)[:-1]])
    return kernels.position_rows(
        kinds, heads, turns, np.array(sequence.directions), rule.every_basis, rule.every_profile, rule.weights,
        rule.order,
    )  # fmt: skip


def view_rows(sequence: HeadingSequence, phi: float) -> tuple[FloatArray, FloatArray]:
    """Rows (40 K, 10 K) and least values (40 K,) of the bound on the change of view."""
    k = len(sequence.turns)
    floor = min(_FLOOR_M, _FLOOR_SHARE * sequence.length_m)
    least = [least_rate(turn, phi, sequence.ends(i), floor) for i, turn in enumerate(sequence.turns)]
    return np.asarray(np.kron(np.eye(k), RATE_ROWS), np.float64), np.concatenate(least)


def build(sequence: HeadingSequence, start: SE2, goal: SE2, phi: float) -> QpProblem:
    """The programme of a sequence between two poses; unknowns are the coefficients (10 K,)."""
    k = len(sequence.turns)
    rows, least = view_rows(sequence, phi)
    target = np.array([goal.x - start.x, goal.y - start.y])
    return QpProblem(
        P=np.eye(COEFFICIENTS * k),
        q=np.concatenate([_LENGTH[sequence.ends(i)] for i in range(k)]) * (0.5 * sequence.length_m / _ENERGY),
        A=np.concatenate([position_rows(sequence, start.theta, COARSE)[:, -1], rows]),
        lower=np.concatenate([target, least]),
        upper=np.concatenate([target, np.full(len(rows), np.inf)]),
    )


def solve(sequence: HeadingSequence, start: SE2, goal: SE2, phi: float) -> Path | None:
    """The path, or None where the sequence has no solution that is proved to keep the bound."""
    problem = build(sequence, start, goal, phi)
    solution = solve_qp(problem)
    return None if solution is None else verified(problem, solution.x, sequence, start, goal, phi)


def verified(
    problem: QpProblem, x: FloatArray, sequence: HeadingSequence, start: SE2, goal: SE2, phi: float
) -> Path | None:
    """The path of coefficients (10 K,), each piece proved to keep phi, when an integration with another rule than the
    solver's confirms goal and bound, else None."""
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
