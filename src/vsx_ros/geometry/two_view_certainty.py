"""How well two views determine their motion and the depths: the flow that a pure rotation leaves unexplained, and the
standard deviations from the Hessian of the adjustment (Triggs et al. 2000, section 9)."""

import itertools
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points2, Points3
from vsx_ros.geometry.epipolar import essential_matrix, homogeneous
from vsx_ros.geometry.se3 import SE3

ROUNDS = 8  # reweighted fits; after five the rotation converges to a hundredth of a pixel
NEAR = 0.3  # of the median error: smaller errors have equal weight, so that none is infinite
TUKEY = 4.6851  # sigmas; larger residuals are outliers: 95 % efficient for Gaussian noise
# The axes and the diagonals of half a sphere: every minimum is reached from one of them.
DIRECTIONS = np.array(
    [v for v in itertools.product((-1.0, 0.0, 1.0), repeat=3) if v > (0.0,) * 3 and sum(map(abs, v)) != 2]
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
STEPS, MAX_STEP, DAMPING = 12, 0.5, 1e-3  # of the descent: enough to converge; rad, limit of linearity; ratio
MAD = 1.4826  # standard deviation of Gaussian noise over its median absolute value


class Certainty(NamedTuple):
    """Standard deviations of a two-view motion of unit baseline: of its direction along the worst axis [rad], and (N,)
    of the logarithm of each depth over the baseline, with the uncertainty of the motion. noise: of the rays, on the
    plane z = 1."""

    direction_rad: float
    log_depth: FloatArray
    noise: float


def pure_rotation(rays_a: Points2, rays_b: Points2) -> tuple[FloatArray, FloatArray]:
    """Rotation R_b_a (3, 3) that fits matched rays (N, 2) on the planes z = 1 with least absolute errors (reweighted
    Kabsch 1976), and the residual (N,) of each on b's plane."""
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    unit_a, unit_b = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (a, b))
    weight = np.ones(len(a))
    for _ in range(ROUNDS):
        U, _, Vt = np.linalg.svd((unit_b * weight[:, None]).T @ unit_a)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        error = np.linalg.norm(unit_b - unit_a @ R.T, axis=1)
        weight = 1.0 / np.maximum(error, NEAR * float(np.median(error)) + 1e-9)
    turned = a @ R.T
    return R, np.linalg.norm(turned[:, :2] / turned[:, 2:] - rays_b, axis=1)


class _Linearised(NamedTuple):
    """Sampson errors (N,) of matched rays; derivatives J (N, 5) by the direction, along ``across`` (3, 2), and by the
    rotation from the left; rays a rotated and b (N, 3)."""

    error: FloatArray
    J: FloatArray
    across: FloatArray
    a: Points3
    b: Points3

    def weights(self, sigma: float) -> FloatArray:
        """Tukey weights (N,)."""
        return np.maximum(0.0, 1.0 - (self.error / (TUKEY * sigma)) ** 2) ** 2

    def sigma(self, least: float) -> float:
        """Robust noise of the errors, at least ``least``."""
        return max(MAD * float(np.median(np.abs(self.error))), least)


def _linearised(T_b_a: SE3, rays_a: Points2, rays_b: Points2) -> _Linearised:
    """The two-view adjustment with the depths eliminated, linearised."""
    a, b, t = homogeneous(rays_a) @ T_b_a.rotation.T, homogeneous(rays_b), T_b_a.translation
    E = essential_matrix(T_b_a)
    lines_b, lines_a = homogeneous(rays_a) @ E.T, b @ E
    size = np.sqrt((lines_b[:, :2] ** 2).sum(axis=1) + (lines_a[:, :2] ** 2).sum(axis=1)) + 1e-12
    across = np.linalg.svd(t[:, None])[0][:, 1:]
    J = np.column_stack([np.cross(a, b) @ across, np.cross(a, np.cross(b, t))]) / size[:, None]
    return _Linearised(error=(b * lines_b).sum(axis=1) / size, J=J, across=across, a=a, b=b)


def certainty(T_b_a: SE3, rays_a: Points2, rays_b: Points2, sigma_min: float) -> Certainty:
    """Certainty of a motion with unit translation that explains matched rays (N, 2) on the planes z = 1, N >= 5 with
    parallax. The noise is estimated from the errors, at least sigma_min."""
    linear = _linearised(T_b_a, rays_a, rays_b)
    _, J, across, a, b = linear
    sigma = linear.sigma(sigma_min)
    covariance = np.linalg.pinv((J * linear.weights(sigma)[:, None]).T @ J, hermitian=True) * sigma**2
    # The depth z of a in the equation z (b x a) = -(b x t), and how its logarithm changes with the motion.
    normal = np.cross(b, a)
    squared = np.maximum((normal * normal).sum(axis=1), 1e-18)
    depth = -(normal * np.cross(b, T_b_a.translation)).sum(axis=1) / squared
    lever = np.cross(normal, b)
    by_direction = -(lever @ across) / (depth * squared)[:, None]
    D = np.column_stack([by_direction, -np.cross(a, lever) / squared[:, None]])
    parallax = np.sqrt(squared) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    variance = ((D @ covariance) * D).sum(axis=1) + 2.0 * (sigma / parallax) ** 2
    return Certainty(float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])), np.sqrt(variance), sigma)


def every_motion(R_b_a: FloatArray, rays_a: Points2, rays_b: Points2, sigma_min: float) -> list[SE3]:
    """Minima of the robust Sampson error near a rotation, one of unit translation from each of the DIRECTIONS. A short
    baseline often allows several, and a random search finds any of them."""
    return [_descended(SE3(R_b_a, t), rays_a, rays_b, sigma_min) for t in DIRECTIONS]


def _descended(T: SE3, rays_a: Points2, rays_b: Points2, sigma_min: float) -> SE3:
    """Reweighted Gauss-Newton, then the sign of the translation with more points in front."""
    for _ in range(STEPS):
        linear = _linearised(T, rays_a, rays_b)
        JW = linear.J * linear.weights(linear.sigma(sigma_min))[:, None]
        H = JW.T @ linear.J
        step = -np.linalg.solve(H + np.diag(DAMPING * np.diag(H) + 1e-12), JW.T @ linear.error)
        t = T.translation + linear.across @ np.clip(step[:2], -MAX_STEP, MAX_STEP)
        turn = SE3.exp(np.concatenate([np.zeros(3), np.clip(step[2:], -MAX_STEP, MAX_STEP)]))
        T = SE3(turn.rotation @ T.rotation, t / np.linalg.norm(t))
    in_front = (np.cross(linear.b, linear.a) * -np.cross(linear.b, T.translation)).sum(axis=1) > 0.0
    return T if 2 * np.count_nonzero(in_front) >= len(in_front) else SE3(T.rotation, -T.translation)
