"""The flat outputs as polynomials (paper 4.1, eq. 1-3), in a basis that can be computed with, and their bound.

The paper writes x(t) and zeta(t) = tan(theta(t)) as sums of powers of t, with xdot and zetadot zero at both ends. The
same polynomials are written here with that factor taken out, on t in [0, 1]:

    xdot(t) = t (1 - t) * sum_k c_k P_k(t),   P_k the Jacobi (2, 2) polynomials, orthonormal for t^2 (1 - t)^2,

so the coefficients c have unit energy norm and the boundary conditions hold by construction. The certified method
uses (theta, rho) with rho = ds/dt in place of (zeta, xdot): the same basis for rho, and theta(t) = theta_0 + d S(t)
with a monotone S-curve S. There is no tangent, hence no forbidden heading.

The bound on the change of view (eq. 5, 6, 11) then reads |thetadot| <= phi rho. Both sides share ``rest_factor``; what
remains, phi p(t) - |q(t)| >= floor, is a polynomial of degree 9 that is linear in the coefficients of rho. If its
Bernstein coefficients on sub-intervals are non-negative, this holds for every t, not only on a grid."""

from math import comb

import numpy as np

from vsx_ros.arrays import FloatArray

COEFFICIENTS = 10  # Free coefficients of a rate: x(t) has degree 12, as in the paper's eq. (2).


def jacobi(t: FloatArray) -> FloatArray:
    """(N, 10) orthonormal P_k^(2,2) on [0, 1] at t (N,)."""
    u = 2.0 * t - 1.0
    values = np.empty((len(u), COEFFICIENTS))
    values[:, 0] = 1.0
    values[:, 1] = 5.0 * u
    for k in range(2, COEFFICIENTS):  # Gegenbauer with lambda = 5/2 is Jacobi (2, 2) up to a factor
        values[:, k] = (2.0 * u * (k + 1.5) * values[:, k - 1] - (k + 3.0) * values[:, k - 2]) / k
    return values * _NORMS


def _norms() -> FloatArray:
    nodes, weights = np.polynomial.legendre.leggauss(16)
    t = 0.5 * (nodes + 1.0)
    squared = (0.5 * weights * (t * (1.0 - t)) ** 2) @ jacobi(t) ** 2
    return 1.0 / np.sqrt(squared)


_NORMS: FloatArray = np.ones(COEFFICIENTS)
_NORMS = _norms()


def rest_factor(t: FloatArray, joint_before: bool, joint_after: bool) -> FloatArray:
    """(N,) the factor of rho that vanishes at the ends where the base rests; t (1 - t) between two rests.

    At a joint the path continues, bending the other way, and rho stays positive."""
    return np.asarray((1.0 if joint_before else t) * (1.0 if joint_after else 1.0 - t) * np.ones_like(t))


def profile_rate(t: FloatArray, joint_before: bool, joint_after: bool) -> FloatArray:
    """(N,) S'(t) / ``rest_factor`` of the S-curve from 0 to 1.

    Between two rests it is the minimiser of eq. (7)-(8), S = 7.5 t^2 - 20 t^3 + 22.5 t^4 - 9 t^5. With a joint it is
    S = 3 t^2 - 2 t^3, whose rate vanishes there more strongly than rho, so that the curvature passes through zero."""
    if joint_before or joint_after:
        return np.asarray(6.0 * (t if joint_before else 1.0) * ((1.0 - t) if joint_after else 1.0) * np.ones_like(t))
    return np.asarray(15.0 * (1.0 - 3.0 * t + 3.0 * t * t))


def profile(t: FloatArray, joint_before: bool, joint_after: bool) -> FloatArray:
    """(N,) S(t), the integral of ``rest_factor`` times ``profile_rate``: S(0) = 0, S(1) = 1, monotone."""
    if joint_before or joint_after:
        return np.asarray(t**2 * (3.0 - 2.0 * t))
    return np.asarray(t**2 * (7.5 - 20.0 * t + 22.5 * t * t - 9.0 * t**3))


JOINT_SLOPE = 6.0  # |q| leaves a joint with this slope per radian of turn, so dkappa/ds = 6 |d| / p^2 there

FLAGS = [(a, b) for a in (False, True) for b in (False, True)]
"""Every pair of end conditions (joint before, joint after)."""


class Quadrature:
    """Composite Gauss-Legendre rule on [0, 1]; its tables are shared by all pieces.

    t (M,) nodes, weights (M,); knots (intervals + 1,). basis[flags] (M, 10): rho is its product with the coefficients.
    every_basis (4, M, 10), every_profile (4, M): the same in the order of ``FLAGS``."""

    def __init__(self, intervals: int, order: int) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(order)
        self.order = order
        self.knots = np.linspace(0.0, 1.0, intervals + 1)
        width = 1.0 / intervals
        self.t = (self.knots[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel()
        self.weights = np.tile(0.5 * width * weights, intervals)
        self.basis = {flag: rest_factor(self.t, *flag)[:, None] * jacobi(self.t) for flag in FLAGS}
        self.knot_jacobi = jacobi(self.knots)
        self.profile = {flag: profile(self.t, *flag) for flag in FLAGS}
        self.every_basis = np.stack([self.basis[flag] for flag in FLAGS])
        self.every_profile = np.stack([self.profile[flag] for flag in FLAGS])
        self.knot_profile = {flag: profile(self.knots, *flag) for flag in FLAGS}
        self.knot_turn_rate = {flag: profile_rate(self.knots, *flag) for flag in FLAGS}

    def integral(self, values: FloatArray) -> FloatArray:
        """(...,) integral over [0, 1] of values (M, ...) given at the nodes."""
        return np.tensordot(self.weights, values, axes=(0, 0))

    def cumulative(self, values: FloatArray) -> FloatArray:
        """(..., intervals + 1) integral from 0 to every knot of values (..., M) given at the nodes."""
        parts = (self.weights * values).reshape(*values.shape[:-1], -1, self.order).sum(axis=-1)
        total: FloatArray = np.zeros((*values.shape[:-1], len(self.knots)))
        np.cumsum(parts, axis=-1, out=total[..., 1:])
        return total


COARSE = Quadrature(intervals=1, order=48)
"""Integrates for the optimisation: exact to rounding for turns below a full circle."""

FINE = Quadrature(intervals=256, order=3)
"""Tabulates the finished path; another rule than ``COARSE``, so the two check each other."""

_SUB_INTERVALS = 4  # per piece: Bernstein bounds are tighter on shorter intervals
_JOINT_RAMP = 8.0
"""Per metre: through a joint the curvature needs at least an eighth of a metre to go from zero to phi."""


def bernstein_rows(values_at: FloatArray, nodes: FloatArray) -> FloatArray:
    """(10, ...) Bernstein coefficients of degree 9 of polynomials with values (10, ...) at nodes (10,) in [0, 1]."""
    n = COEFFICIENTS - 1
    vandermonde = np.stack([comb(n, j) * nodes**j * (1.0 - nodes) ** (n - j) for j in range(n + 1)], axis=1)
    return np.asarray(np.linalg.solve(vandermonde, values_at), np.float64)


_NODES: FloatArray = 0.5 - 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)  # Chebyshev
_PLACES = [(i + _NODES) / _SUB_INTERVALS for i in range(_SUB_INTERVALS)]

RATE_ROWS: FloatArray = np.concatenate([bernstein_rows(jacobi(t), _NODES) for t in _PLACES])
"""(40, 10): times the coefficients of rho gives the Bernstein coefficients of p = rho / rest_factor."""

TURN_ROWS: dict[tuple[bool, bool], FloatArray] = {
    flags: np.concatenate([bernstein_rows(profile_rate(t, *flags), _NODES) for t in _PLACES]) for flags in FLAGS
}
"""(40,) Bernstein coefficients of q = S' / rest_factor for every pair of end conditions (joint before, joint after)."""


def least_rate(turn: float, phi: float, joints: tuple[bool, bool], floor: float) -> FloatArray:
    """(40,) lower bounds of ``RATE_ROWS`` times the coefficients, so that |dtheta/ds| <= phi with a little room.

    At a joint p must also be so large that the curvature does not change faster than ``_JOINT_RAMP`` phi per metre."""
    least: FloatArray = abs(turn) / phi * TURN_ROWS[joints] + floor
    ramp = np.sqrt(JOINT_SLOPE * abs(turn) / (_JOINT_RAMP * phi))
    for row, joint in ((0, joints[0]), (-1, joints[1])):
        if joint:
            least[row] = max(float(least[row]), float(ramp))
    return least


def curvature_bound(coefficients: FloatArray, turn: float, joints: tuple[bool, bool]) -> float:
    """An upper bound of |dtheta/ds| over the whole piece [rad/m]; infinite when rho is not proved positive.

    If every Bernstein coefficient of |q| is at most r times that of p > 0, then |q| <= r p everywhere."""
    p = RATE_ROWS @ coefficients
    if float(p.min()) <= 0.0:
        return float("inf")
    return float(np.max(np.abs(turn) * TURN_ROWS[joints] / p, initial=0.0))
