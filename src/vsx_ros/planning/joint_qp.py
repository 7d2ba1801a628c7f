"""One quadratic programme for all pieces of a heading sequence.

With theta(t) fixed in every piece, positions, length and the bound on the change of view are all linear in the
coefficients of rho_k = ds/dt >= 0 of all pieces jointly. Cusp positions are not chosen: the solution places them.

    minimise    sum_k  int rho_k dt  +  w int rho_k^2 dt          (length and a little energy)
    subject to  sum_k direction_k int rho_k (cos theta_k, sin theta_k) dt = goal position
                phi p_k(t) - |q_k(t)| >= phi floor  for all t       (fov_bound.py)
"""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.planning import curves as kernels
from vsx_ros.planning.flat_output import COARSE, COEFFICIENTS, FLAGS, Quadrature
from vsx_ros.planning.fov_bound import RATE_ROWS, curvature_bound, least_rate
from vsx_ros.planning.heading_sequences import HeadingSequence
from vsx_ros.planning.path import Path, certified
from vsx_ros.planning.pieces import Piece, curve_piece
from vsx_ros.planning.qp import QpProblem, solve_qp

_ENERGY = 0.01
_FLOOR_M = 0.01
_FLOOR_SHARE = 0.02
_EXACT = 1e-9
_LENGTH = {flags: COARSE.integral(COARSE.basis[flags]) for flags in FLAGS}


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
