"""Fits a smooth path to arcs and lines in the map. (``sliding_fit.py`` fits long ones in windows.)

Positions are linear in the unknowns of the joint programme. So half-planes keep the clearance at samples of every
piece: they linearise the margin field at the previous solution, within a trust region. A few rounds are enough."""

import itertools

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning import joint_qp
from vsx_ros.planning.corridor import Corridor
from vsx_ros.planning.flat_output import COEFFICIENTS, Quadrature
from vsx_ros.planning.joint_qp import HeadingSequence, QpProblem, solve_qp
from vsx_ros.planning.path import Path
from vsx_ros.planning.pieces import Piece

_SAMPLES = Quadrature(intervals=32, order=4)  # per piece; the path is kept in the corridor at the interval ends
_FEW = slice(3, None, 4)  # samples with a trust region
_FOLLOW, _SLACK_PRICE = 50.0, 200.0  # weight of following the coarse path; of leaving the corridor, the last resort
_TRUST_M, _NEAR_M, _GAP_M = 0.15, 0.3, 0.004  # trust region near obstacles; what is near; extra gap
_HOPELESS_M = (0.1, 0.02, 0.0, 0.0, 0.0)
"""One entry per round: how much room may be missing after it for another round to be useful."""
_CONVERGED = 0.01  # share of length; a round that gains less is the last


def coarse_points(sequence: HeadingSequence, pieces: list[list[Piece]]) -> FloatArray:
    """(32 K, 2) points of the coarse path at the headings that the pieces will have at their samples.

    pieces[k]: arcs and lines that piece k of the sequence replaces."""
    points = []
    for k, run in enumerate(pieces):
        tables = [arc.table for arc in run]
        share = _SAMPLES.knot_profile[sequence.ends(k)][1:]
        x, y = (np.concatenate([table[:, column] for table in tables]) for column in (1, 2))
        # Order by heading, then by length for ties on straight lines.
        s = np.cumsum(np.concatenate([np.diff(table[:, 0], prepend=0.0) for table in tables]))
        turned = np.abs(np.concatenate([table[:, 3] for table in tables]) - tables[0][0, 3])
        key = np.maximum.accumulate(turned) + 1e-3 * s
        wanted = share * key[-1]
        points.append(np.stack([np.interp(wanted, key, x), np.interp(wanted, key, y)], axis=1))
    return np.concatenate(points)


def fit(
    sequence: HeadingSequence, runs: list[list[Piece]], start: SE2, goal: SE2, phi: float, corridor: Corridor,
    reverse_rooms_m: list[float],
) -> Path | None:  # fmt: skip
    """The shortest path found with a sequence's headings that stays in the corridor, or None.

    runs: what each piece replaces, arcs and lines or a curve fitted before; the search begins there. reverse_rooms_m:
    the greatest length of each leg in reverse [m]."""
    base = _bounded(joint_qp.build(sequence, start, goal, phi), sequence, reverse_rooms_m)
    X, Y = joint_qp.position_rows(sequence, start.theta, _SAMPLES)
    guide = coarse_points(sequence, runs) - np.array([start.x, start.y])
    first = solve_qp(_following(base, X, Y, guide))
    if first is None:
        return None
    x, best = first.x, None
    trust, gap = _TRUST_M, _GAP_M
    # The rows of the bound that are active along the guide are a good guess for the shortest path.
    duals = np.concatenate([first.duals, np.zeros(len(X) + 2 * len(X[_FEW])), [-1.0]])
    for hopeless_m in _HOPELESS_M:
        round_, kept = _round(base, X, Y, x, start, corridor, trust, gap)
        answer = solve_qp(round_, duals[kept])
        if answer is None:
            break
        duals = np.zeros(len(kept))
        duals[kept] = answer.duals
        before, x = x, answer.x[:-1]
        path = joint_qp.verified(base, x, sequence, start, goal, phi)
        if path is None:
            break
        short = -corridor.least_margin(path)
        if short > 0.0:
            if best is not None or short > hopeless_m:
                break
            gap += short + _GAP_M
            trust *= 0.6
        else:
            best = path if best is None or path.length_m < best.length_m else best
            if base.q @ x > (1.0 - _CONVERGED) * (base.q @ before):  # q x is proportional to the length
                break
    return best


def reverse_legs(sequence: HeadingSequence) -> list[list[int]]:
    """The pieces of each leg in reverse."""
    legs = itertools.groupby(range(len(sequence.turns)), key=lambda k: sequence.directions[k])
    return [list(leg) for direction, leg in legs if direction < 0]


def _bounded(base: QpProblem, sequence: HeadingSequence, reverse_rooms_m: list[float]) -> QpProblem:
    """The programme with a bound on the length of each leg in reverse."""
    legs = reverse_legs(sequence)
    rows = np.zeros((len(legs), len(sequence.turns), COEFFICIENTS))
    for row, leg in zip(rows, legs):
        row[leg] = [joint_qp.LENGTH[sequence.ends(k)] for k in leg]
    return base._replace(
        A=np.concatenate([base.A, rows.reshape(len(legs), base.A.shape[1])]),
        lower=np.concatenate([base.lower, np.full(len(legs), -np.inf)]),
        upper=np.concatenate([base.upper, reverse_rooms_m]),
    )


def _following(base: QpProblem, X: FloatArray, Y: FloatArray, guide: FloatArray) -> QpProblem:
    """The programme of the curve that comes closest to the guide's points (32 K, 2)."""
    return QpProblem(
        P=1e-3 * base.P + _FOLLOW * (X.T @ X + Y.T @ Y),
        q=-_FOLLOW * (X.T @ guide[:, 0] + Y.T @ guide[:, 1]),
        A=base.A, lower=base.lower, upper=base.upper,
    )  # fmt: skip


def _round(
    base: QpProblem, X: FloatArray, Y: FloatArray, x: FloatArray, start: SE2, corridor: Corridor, trust: float,
    gap: float,
) -> tuple[QpProblem, BoolArray]:  # fmt: skip
    """The programme with the margin field linearised at x, and one slack for all its half-planes as the last unknown.

    On open ground half-planes are left out, and samples may move farther. The second value marks the rows that
    remain."""
    points = np.stack([X @ x, Y @ x], axis=1)
    world = points + np.array([start.x, start.y])
    margin, normal = corridor.margin.at(world), corridor.margin.gradient(world)
    size = np.linalg.norm(normal, axis=1)
    near = (margin < _NEAR_M) & (size > 0.1)
    normal = normal[near] / size[near, None]
    planes = normal[:, :1] * X[near] + normal[:, 1:] * Y[near]
    least = np.sum(normal * points[near], axis=1) - margin[near] + gap
    few, reach = points[_FEW].T, np.where(near, trust, np.maximum(trust, 0.8 * margin))[_FEW]
    n, first, last = base.A.shape[1], len(base.A), len(base.A) + len(planes)
    A = np.zeros((last + few.size + 1, n + 1))
    np.concatenate([base.A, planes, X[_FEW], Y[_FEW]], out=A[:-1, :n])
    A[first:last, n] = A[-1, n] = 1.0
    problem = QpProblem(
        P=np.eye(n + 1),
        q=np.append(base.q, _SLACK_PRICE * float(np.abs(base.q).max())),
        A=A,
        lower=np.concatenate([base.lower, least, *(few - reach), [0.0]]),
        upper=np.concatenate([base.upper, np.full(len(planes), np.inf), *(few + reach), [np.inf]]),
    )
    return problem, np.concatenate([np.ones(first, np.bool_), near, np.ones(few.size + 1, np.bool_)])
