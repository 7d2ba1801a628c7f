"""Robust six-degree pose from points and pixels. Perturbation: T_cam_world <- exp(xi) T_cam_world, xi = (rho,
omega)."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry import compose, exp_se3, orthonormalize, row_share, transform, unproject_pixel
from vsx_ros.kernels.linalg.cholesky import factor_in_place, solve_factored

TUKEY = 4.6851
TO_SIGMA = 1.4826


@kernel
def tukey_sigma(squared: FloatArray, n: int, sigma_min: float) -> float:
    """Robust standard deviation of n residuals from the median of their squares (PTAM's small-sample factor)."""
    if n < 6:
        return max(sigma_min, 4.0)
    to_sigma = TO_SIGMA * (1.0 + 5.0 / (2.0 * n - 6.0))
    # Counting shows whether the median is below the floor, and is much faster than finding it.
    floor = (sigma_min / to_sigma) * (sigma_min / to_sigma)
    below = 0
    for i in range(n):
        if squared[i] <= floor:
            below += 1
    if 2 * below > n:
        return sigma_min
    return max(sigma_min, to_sigma * math.sqrt(np.median(squared[:n])))


@kernel
def add_observation(
    K: FloatArray, x: float, y: float, iz: float, wu: float, wv: float, scale: float, H: FloatArray, g: FloatArray
) -> None:
    """Add scale * J^T J to the upper triangle of H (6, 6) and J^T (wu, wv) to g (6,). J (2, 6): derivative by xi of the
    undistorted pixel of the camera point (x, y, 1) / iz; K (4,): fx, fy, cx, cy."""
    a0, a2, a3, a4, a5 = K[0] * iz, -K[0] * iz * x, -K[0] * x * y, K[0] * (1.0 + x * x), -K[0] * y
    b1, b2, b3, b4, b5 = K[1] * iz, -K[1] * iz * y, -K[1] * (1.0 + y * y), K[1] * x * y, K[1] * x
    sa0, sa2, sa3, sa4, sa5 = scale * a0, scale * a2, scale * a3, scale * a4, scale * a5
    sb1, sb2, sb3, sb4, sb5 = scale * b1, scale * b2, scale * b3, scale * b4, scale * b5
    g[0] += a0 * wu
    g[1] += b1 * wv
    g[2] += a2 * wu + b2 * wv
    g[3] += a3 * wu + b3 * wv
    g[4] += a4 * wu + b4 * wv
    g[5] += a5 * wu + b5 * wv
    H[0, 0] += sa0 * a0
    H[0, 2] += sa0 * a2
    H[0, 3] += sa0 * a3
    H[0, 4] += sa0 * a4
    H[0, 5] += sa0 * a5
    H[1, 1] += sb1 * b1
    H[1, 2] += sb1 * b2
    H[1, 3] += sb1 * b3
    H[1, 4] += sb1 * b4
    H[1, 5] += sb1 * b5
    H[2, 2] += sa2 * a2 + sb2 * b2
    H[2, 3] += sa2 * a3 + sb2 * b3
    H[2, 4] += sa2 * a4 + sb2 * b4
    H[2, 5] += sa2 * a5 + sb2 * b5
    H[3, 3] += sa3 * a3 + sb3 * b3
    H[3, 4] += sa3 * a4 + sb3 * b4
    H[3, 5] += sa3 * a5 + sb3 * b5
    H[4, 4] += sa4 * a4 + sb4 * b4
    H[4, 5] += sa4 * a5 + sb4 * b5
    H[5, 5] += sa5 * a5 + sb5 * b5


@kernel
def _undistorted(camera: FloatArray, uv: FloatArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """Undistorted pixels (N, 2) from the principal point, and shares of the readout (N,), of uv at index (N,)."""
    n = index.shape[0]
    observed, share = np.empty((n, 2)), np.empty(n)
    for k in range(n):
        u, v = uv[index[k], 0], uv[index[k], 1]
        x, y = unproject_pixel(camera, u, v)
        observed[k, 0], observed[k, 1] = x * camera[0], y * camera[1]
        share[k] = row_share(camera, v)
    return observed, share


@kernel
def _solve_with_prior(
    H: FloatArray, g: FloatArray, prior: FloatArray, variance: float, drift: FloatArray, A: FloatArray,
    step: FloatArray,
) -> bool:  # fmt: skip
    """Fill step with the solution of H, g and a diagonal prior that pulls back the drift so far; add step to drift.
    Fills A with the matrix; False when it is singular."""
    for a in range(6):
        for b in range(a, 6):
            A[a, b] = H[a, b]
        A[a, a] += prior[a] * variance + 1e-9
        step[a] = g[a] - prior[a] * variance * drift[a]
    if not factor_in_place(A):
        return False
    solve_factored(A, step)
    for a in range(6):
        drift[a] += step[a]
    return True


@kernel
def _residuals(
    camera: FloatArray, R: FloatArray, t: FloatArray, points: FloatArray, rows: IntArray, level: IntArray,
    index: IntArray, observed: FloatArray, share: FloatArray, cam: FloatArray, res: FloatArray, squared: FloatArray,
) -> int:  # fmt: skip
    """Fill the points in the camera (N, 3), weighted residuals (N, 2) and the squares of those in front of it; returns
    their number."""
    m = 0
    for i in range(index.shape[0]):
        p = rows[index[i]]
        x, y, z = transform(R, t, points[p, 0], points[p, 1], points[p, 2])
        cam[i, 0], cam[i, 1] = x - share[i] * camera[15], y - share[i] * camera[16]
        cam[i, 2] = z - share[i] * camera[17]
        if cam[i, 2] > 1e-6:
            weight = 1.0 / (1 << level[index[i]])
            res[i, 0] = (observed[i, 0] - camera[0] * cam[i, 0] / cam[i, 2]) * weight
            res[i, 1] = (observed[i, 1] - camera[1] * cam[i, 1] / cam[i, 2]) * weight
            squared[m] = res[i, 0] * res[i, 0] + res[i, 1] * res[i, 1]
            m += 1
    return m


@kernel
def _normal_equations(
    K: FloatArray, cam: FloatArray, res: FloatArray, level: IntArray, index: IntArray, limit: float,
    weights: FloatArray, H: FloatArray, g: FloatArray,
) -> None:  # fmt: skip
    """Fill H (6, 6; upper triangle), g (6,) and Tukey weights of the matches, zero from the square ``limit`` on."""
    H[:, :] = 0.0
    g[:] = 0.0
    for i in range(index.shape[0]):
        weights[index[i]] = 0.0
        if cam[i, 2] <= 1e-6:
            continue
        e = res[i, 0] * res[i, 0] + res[i, 1] * res[i, 1]
        if e >= limit:
            continue
        root = 1.0 - e / limit
        weights[index[i]] = root * root
        weight = 1.0 / (1 << level[index[i]])
        scale = root * root * weight
        wu, wv, iz = scale * res[i, 0], scale * res[i, 1], 1.0 / cam[i, 2]
        add_observation(K, cam[i, 0] * iz, cam[i, 1] * iz, iz, wu, wv, scale * weight, H, g)


@kernel
def optimize_pose(
    camera: FloatArray, R0: FloatArray, t0: FloatArray, points: FloatArray, rows: IntArray, uv: FloatArray,
    level: IntArray, found: BoolArray, prior_information: FloatArray, wide: int, iterations: int, sigma_min: float,
    sigma_max: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:  # fmt: skip
    """Tukey-weighted Gauss-Newton on T_cam_world, on undistorted pixels.

    points (P, 3) world. Matches: rows (S,), uv (S, 2) level-0 px, level (S,); those with found (S,) are used, each with
    sigma 2^level. prior_information (6,): diagonal pull towards the start. Returns R, t, weights (S,) in [0, 1] (0:
    outlier or not found), information (6, 6), sigma [px].
    The first ``wide`` iterations keep sigma wide so that a bad start does not reject everything. Later, a sigma of at
    most ``sigma_max`` rejects outliers: matches from a small circle all have small residuals, and by their median wrong
    ones would fit. The returned sigma is not limited."""
    K, index = camera[:4], np.flatnonzero(found)
    n = index.shape[0]
    observed, share = _undistorted(camera, uv, index)
    R, t = R0.copy(), t0.copy()
    weights = np.zeros(found.shape[0])
    H, A = np.zeros((6, 6)), np.zeros((6, 6))
    g, step, drift = np.zeros(6), np.zeros(6), np.zeros(6)
    squared = np.empty(n)
    res, cam = np.empty((n, 2)), np.empty((n, 3))
    sigma = believed = sigma_min
    for iteration in range(iterations):
        m = _residuals(camera, R, t, points, rows, level, index, observed, share, cam, res, squared)
        sigma = tukey_sigma(squared, m, max(sigma_min, 3.0) if iteration < wide else sigma_min)
        believed = sigma if iteration < wide else min(sigma, sigma_max)
        _normal_equations(K, cam, res, level, index, TUKEY * TUKEY * believed * believed, weights, H, g)
        if not _solve_with_prior(H, g, prior_information, sigma * sigma, drift, A, step):
            break
        dR, dt = exp_se3(step)
        R, t = compose(dR, dt, R, t)
        if iteration >= wide and np.abs(step).max() < 1e-6:
            break
    orthonormalize(R)
    for a in range(6):
        for b in range(a + 1, 6):
            H[b, a] = H[a, b]
    return R, t, weights, H / (believed * believed), sigma
