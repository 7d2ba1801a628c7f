"""How well two views determine their motion and the depths: what a pure rotation leaves of the flow, and the standard
deviations from the Hessian of the adjustment (Triggs et al. 2000, section 9)."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.geometry.epipolar import essential_matrix, homogeneous
from vsx_ros.geometry.se3 import SE3

ROUNDS = 8  # reweighted fits; the rotation is settled to a hundredth of a pixel after five
NEAR = 0.3  # of the median error: what is smaller weighs alike, so that no weight is infinite
TUKEY = 4.6851  # sigmas, beyond which a residual is an outlier's: 95 % efficient for Gaussian noise
MAD = 1.4826  # standard deviation of Gaussian noise over its median absolute value


class Certainty(NamedTuple):
    """Standard deviations of a two-view motion of unit baseline: of its direction along the worst axis [rad], and (N,)
    of the logarithm of each point's depth over the baseline, with what the motion leaves open. noise: of the rays, on
    the plane z = 1."""

    direction_rad: float
    log_depth: FloatArray
    noise: float


def pure_rotation(rays_a: Points2, rays_b: Points2) -> tuple[FloatArray, FloatArray]:
    """The rotation R_b_a (3, 3) that explains most of matched rays (N, 2) on the planes z = 1, in the sense of least
    absolute errors (reweighted Kabsch 1976), and what it leaves (N,) of each on b's plane."""
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


def certainty(T_b_a: SE3, rays_a: Points2, rays_b: Points2, sigma_min: float) -> Certainty:
    """Of a motion with unit translation that explains matched rays (N, 2) on the planes z = 1, N >= 5 with parallax.

    The noise is what the residuals show, but no less than sigma_min. With the depths eliminated what is left of the
    adjustment is the Sampson error of five unknowns: the direction across itself, and the rotation."""
    a, b, t = homogeneous(rays_a) @ T_b_a.rotation.T, homogeneous(rays_b), T_b_a.translation
    E = essential_matrix(T_b_a)
    lines = homogeneous(rays_a) @ E.T, b @ E
    size = np.sqrt((lines[0][:, :2] ** 2).sum(axis=1) + (lines[1][:, :2] ** 2).sum(axis=1))
    residual = (b * lines[0]).sum(axis=1) / size
    sigma = max(MAD * float(np.median(np.abs(residual))), sigma_min)
    weight = np.maximum(0.0, 1.0 - (residual / (TUKEY * sigma)) ** 2) ** 2
    across = np.linalg.svd(t[:, None])[0][:, 1:]
    J = np.column_stack([np.cross(a, b) @ across, np.cross(a, np.cross(b, t))]) / size[:, None]
    covariance = np.linalg.pinv((J * weight[:, None]).T @ J, hermitian=True) * sigma**2
    # The depth z of a in the equation z (b x a) = -(b x t), and how its logarithm changes with the motion.
    normal = np.cross(b, a)
    squared = np.maximum((normal * normal).sum(axis=1), 1e-18)
    depth = -(normal * np.cross(b, t)).sum(axis=1) / squared
    lever = np.cross(normal, b)
    by_direction = -(lever @ across) / (depth * squared)[:, None]
    D = np.column_stack([by_direction, -np.cross(a, lever) / squared[:, None]])
    parallax = np.sqrt(squared) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    variance = ((D @ covariance) * D).sum(axis=1) + 2.0 * (sigma / parallax) ** 2
    return Certainty(float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])), np.sqrt(variance), sigma)
