"""The paper's two-level optimisation of one segment (paper 4.2, 4.3).

The paper's text needs additions to work: t in [0, 1]; the frame is turned to the middle of both headings; the factor
t (1 - t) is divided out of both sides of (11), so that it also holds in the limit at the ends; reverse driving is the
mirrored problem. Level one, zeta(t) = tan(theta(t)) by (7)-(8), has a closed form, zeta_f (2 S(t) - 1) with the S-curve
of ``profile``. Level two is a programme in the coefficients c (10,) of xdot."""

import math
from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.planning.flat_output import COARSE, COEFFICIENTS, FINE
from vsx_ros.planning.joint_qp import QpProblem, check_question, solve_qp
from vsx_ros.planning.path import Path, Refusal, RefusalKind, certified
from vsx_ros.planning.pieces import Piece

_ROUNDS = 4  # of solving with a tighter phi, at most
_TOLERANCE, _EXACT = 1e-3, 1e-9  # allowed excess over phi, as a share; rounding [rad]
_REST = (False, False)
_GRID = np.round(np.linspace(0, len(FINE.knots) - 1, 52)).astype(np.int64)
"""The knots of ``FINE`` nearest to an even grid t_0, t_1 .. t_50, t_f."""


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Result of the closed form; margin_m: how far inside (positive) or outside the cone the goal lies."""

    ok: bool
    margin_m: float
    reason: str


def feasible(start: SE2, goal: SE2, phi: float, reverse: bool = False) -> Feasibility:
    """Whether one segment in one direction with monotone heading can join the poses: the exact reach of the paper.

    Eq. (7)-(8) make the heading monotone and (11) forbids reversing, so the segment is the minimal arc
    E = (sin|d|, sign(d) (1 - cos d)) / phi plus a (1, 0) + b (cos d, sin d) with a, b >= 0 for the heading change d:
    the goal must lie in the cone of start and goal direction behind the arc. Raises PlanningError as ``connect``."""
    check_question(start, goal, phi)
    relative = start.inverse() @ goal
    x, y, d = relative.x, relative.y, wrap_angle(relative.theta)
    if reverse:  # the mirrored problem: x -> -x, theta -> -theta
        x, d = -x, -d
    way = "in reverse" if reverse else "forwards"
    half_circle = math.pi - abs(d) < _EXACT  # then the turn may go either way
    sign = 1.0 if (y if half_circle else d) >= 0.0 else -1.0
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


def build(zeta_f: float, x_f: float, y_f: float, phi: float) -> QpProblem:
    """The programme (9)-(11).

    (9)   min sum_i (y(t_i+1) - y(t_i))^2 + (x(t_i+1) - x(t_i))^2
    (10)  x(t_f) = x_f, y(t_f) = y_f                                 (rest at the ends by the basis)
    (11)  +-zetadot(t_i) - (1 + zeta(t_i)^2)^(3/2) xdot(t_i) phi <= 0"""
    coarse, zeta = COARSE.basis[_REST], zeta_f * (2.0 * COARSE.profile[_REST] - 1.0)
    ends = np.stack([COARSE.integral(coarse), COARSE.integral(zeta[:, None] * coarse)])  # eq. (3), ydot = xdot zeta
    basis = FINE.basis[_REST].T
    dx = np.diff(FINE.cumulative(basis)[:, _GRID]).T
    dy = np.diff(FINE.cumulative(zeta_f * (2.0 * FINE.profile[_REST] - 1.0) * basis)[:, _GRID]).T
    zeta = zeta_f * (2.0 * FINE.knot_profile[_REST][_GRID] - 1.0)
    view = ((1.0 + zeta**2) ** 1.5 * phi)[:, None] * FINE.knot_jacobi[_GRID]
    rate = 2.0 * zeta_f * FINE.knot_turn_rate[_REST][_GRID]
    target = np.array([x_f, y_f])
    return QpProblem(
        P=2.0 * (dx.T @ dx + dy.T @ dy) + 1e-9 * np.eye(COEFFICIENTS),
        q=np.zeros(COEFFICIENTS),
        A=np.concatenate([ends, view, view]),
        lower=np.concatenate([target, rate, -rate]),
        upper=np.concatenate([target, np.full(2 * len(_GRID), np.inf)]),
    )


def _curve(zeta_f: float, c: FloatArray) -> FloatArray:
    """(M, 5) table s, x, y, theta, kappa at the knots, in the frame of the middle heading."""
    xdot = FINE.basis[_REST] @ c
    zeta_fine, zeta = (zeta_f * (2.0 * s - 1.0) for s in (FINE.profile[_REST], FINE.knot_profile[_REST]))
    table = np.empty((len(FINE.knots), 5))
    table[:, 0] = FINE.cumulative(xdot * np.sqrt(1.0 + zeta_fine**2))
    table[:, 1] = FINE.cumulative(xdot)
    table[:, 2] = FINE.cumulative(xdot * zeta_fine)
    table[:, 3] = np.arctan(zeta)
    p = FINE.knot_jacobi @ c
    # Eq. (6); where xdot is not positive, no heading fits and no bound holds.
    rate = 2.0 * zeta_f * FINE.knot_turn_rate[_REST]
    table[:, 4] = rate / ((1.0 + zeta**2) ** 1.5 * np.where(p > 0.0, p, 1e-300))
    return table


def segment(relative: SE2, phi: float) -> tuple[FloatArray, float] | str:
    """One forward segment from the origin to a pose: its table (M, 5) and its densely measured bound, or why there is
    none.

    Between the grid points of (11) the curve may exceed phi. Then phi is reduced by the measured excess and the
    programme solved again, a few times at most."""
    middle = 0.5 * wrap_angle(relative.theta)
    zeta_f = math.tan(middle)
    c_mid, s_mid = math.cos(middle), math.sin(middle)
    x_f, y_f = c_mid * relative.x + s_mid * relative.y, c_mid * relative.y - s_mid * relative.x
    tight, worst = phi, math.inf
    for _ in range(_ROUNDS):
        problem = build(zeta_f, x_f, y_f, tight)
        solution = solve_qp(problem)
        if solution is None:
            return f"no polynomials of this degree turn at {tight:.3f} rad/m at most"
        c = solution.x + np.linalg.lstsq(problem.A[:2], problem.lower[:2] - problem.A[:2] @ solution.x, rcond=None)[0]
        table = _curve(zeta_f, c)
        worst = float(np.abs(table[:, 4]).max())
        if worst <= phi * (1.0 + _TOLERANCE):
            x, y = table[:, 1].copy(), table[:, 2].copy()
            table[:, 1], table[:, 2] = c_mid * x - s_mid * y, s_mid * x + c_mid * y
            table[:, 3] += middle
            return table, worst
        tight = min(tight, tight * phi / min(worst, 1.2 * phi))
    shown = f"{worst:.3f} rad/m" if worst < 1e6 else "an infinite rate, because xdot is not positive everywhere,"
    return f"the curve turns at {shown} where {phi:g} rad/m are allowed"


def connect_paper(start: SE2, goal: SE2, phi: float) -> Path | Refusal:
    """The paper's method between two poses in free space: one segment, forwards or else in reverse.

    The certificate's bound is the largest value measured at 257 points, at most 0.1 % above phi."""
    reasons = []
    found: list[Path] = []
    for reverse in (False, True):
        way = "in reverse" if reverse else "forwards"
        verdict = feasible(start, goal, phi, reverse)
        if not verdict.ok:
            reasons.append(verdict.reason)
            continue
        relative = start.inverse() @ goal
        if reverse:
            relative = SE2(-relative.x, relative.y, -relative.theta)
        answer = segment(relative, phi)
        if isinstance(answer, str):
            reasons.append(f"{way} the reach allows it, but {answer}")
            continue
        table, worst = answer
        piece = _placed(table, start, goal, -1 if reverse else 1, worst)
        found.append(certified(start, goal, (piece,), "dense samples of the two-level optimisation"))
    if found:
        return min(found, key=lambda path: path.length_m)
    return Refusal(RefusalKind.INFEASIBLE, "; ".join(reasons))


def _placed(table: FloatArray, start: SE2, goal: SE2, direction: int, bound: float) -> Piece:
    """The segment moved to its start in the world, mirrored when it is driven in reverse."""
    table = table.copy()
    if direction < 0:
        table[:, 1] *= -1.0
        table[:, 3:] *= -1.0
    table[:, 1:3] = start @ table[:, 1:3]
    table[:, 3] += start.theta
    table[-1, 3] = start.theta + start.angle_to(goal)
    return Piece(direction, table, bound)
