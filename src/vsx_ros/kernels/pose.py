"""Robust six-degree pose from points and pixels. Perturbation: T_cam_world <- exp(xi) T_cam_world, xi = (rho,
omega)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel

TUKEY = 4.6851
TO_SIGMA = 1.4826


@kernel
def exp_se3(xi: Any) -> tuple[Any, Any]:
    """Rotation (3, 3) and translation (3,) of the tangent vector (6,)."""
    wx, wy, wz = xi[3], xi[4], xi[5]
    angle2 = wx * wx + wy * wy + wz * wz
    if angle2 < 1e-10:
        a, b, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = math.sqrt(angle2)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / angle2
        c = (1.0 - a) / angle2
    W = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    R = np.empty((3, 3))
    t = np.zeros(3)
    for i in range(3):
        for j in range(3):
            w2 = W[i, 0] * W[0, j] + W[i, 1] * W[1, j] + W[i, 2] * W[2, j]
            unit = 1.0 if i == j else 0.0
            R[i, j] = unit + a * W[i, j] + b * w2
            t[i] += (unit + b * W[i, j] + c * w2) * xi[j]
    return R, t


@kernel
def compose(Ra: Any, ta: Any, Rb: Any, tb: Any) -> tuple[Any, Any]:
    """(R, t) of the product of two rigid motions."""
    R = np.empty((3, 3))
    t = np.empty(3)
    for i in range(3):
        for j in range(3):
            R[i, j] = Ra[i, 0] * Rb[0, j] + Ra[i, 1] * Rb[1, j] + Ra[i, 2] * Rb[2, j]
        t[i] = Ra[i, 0] * tb[0] + Ra[i, 1] * tb[1] + Ra[i, 2] * tb[2] + ta[i]
    return R, t


@kernel
def orthonormalize(R: Any) -> None:
    """Make the rows of a nearly orthonormal (3, 3) matrix exactly so, in place.

    Poses are composed thousands of times from one another; without this the rounding errors multiply.
    """
    for i in range(3):
        for k in range(i):
            dot = R[i, 0] * R[k, 0] + R[i, 1] * R[k, 1] + R[i, 2] * R[k, 2]
            for j in range(3):
                R[i, j] -= dot * R[k, j]
        norm = math.sqrt(R[i, 0] * R[i, 0] + R[i, 1] * R[i, 1] + R[i, 2] * R[i, 2])
        for j in range(3):
            R[i, j] /= norm


@kernel
def point_jacobian(K: Any, x: float, y: float, z: float, J: Any) -> None:
    """Fill J (2, 6): derivative of the undistorted pixel of the camera point (x, y, z) by xi. K (4,): fx, fy, cx,
    cy."""
    iz = 1.0 / z
    a, b = K[0] * iz, K[1] * iz
    xn, yn = x * iz, y * iz
    J[0, 0], J[0, 1], J[0, 2] = a, 0.0, -a * xn
    J[1, 0], J[1, 1], J[1, 2] = 0.0, b, -b * yn
    J[0, 3], J[0, 4], J[0, 5] = -K[0] * xn * yn, K[0] * (1.0 + xn * xn), -K[0] * yn
    J[1, 3], J[1, 4], J[1, 5] = -K[1] * (1.0 + yn * yn), K[1] * xn * yn, K[1] * xn


@kernel
def tukey_sigma(squared: Any, n: int, sigma_min: float) -> float:
    """Robust standard deviation of n residuals from the median of their squares (PTAM's small-sample factor)."""
    if n < 6:
        return max(sigma_min, 4.0)
    median = np.median(squared[:n])
    return max(sigma_min, TO_SIGMA * (1.0 + 5.0 / (2.0 * n - 6.0)) * math.sqrt(median))


@kernel
def factor_in_place(A: Any) -> bool:
    """Upper Cholesky factor of the symmetric A (upper triangle read and overwritten); False when not positive
    definite.

    Right-looking with contiguous row updates: vectorises without reassociating sums, hence reproducible.
    """
    n = A.shape[0]
    for k in range(n):
        pivot = A[k, k]
        if not pivot > 1e-12:
            return False
        root = math.sqrt(pivot)
        for j in range(k, n):
            A[k, j] /= root
        for i in range(k + 1, n):
            f = A[k, i]
            if f != 0.0:
                for j in range(i, n):
                    A[i, j] -= f * A[k, j]
    return True


@kernel
def solve_factored(U: Any, b: Any) -> None:
    """Overwrite b with the solution of U^T U x = b."""
    n = U.shape[0]
    for k in range(n):
        b[k] /= U[k, k]
        f = b[k]
        for j in range(k + 1, n):
            b[j] -= f * U[k, j]
    for k in range(n - 1, -1, -1):
        s = b[k]
        for j in range(k + 1, n):
            s -= U[k, j] * b[j]
        b[k] = s / U[k, k]


@kernel
def optimize_pose(
    K: Any,
    R0: Any,
    t0: Any,
    points: Any,
    observed: Any,
    weight: Any,
    prior_information: Any,
    iterations: int,
    sigma_min: float,
) -> tuple[Any, Any, Any, Any, float]:
    """Tukey-weighted Gauss-Newton on T_cam_world.

    points (N, 3) world, observed (N, 2) undistorted px, weight (N,) = 2^-level, prior_information (6,): diagonal
    pull towards the start. Returns R, t, weights (N,) in [0, 1] (0: outlier), information (6, 6), sigma [px].
    The first third of the iterations keeps sigma wide so that a bad start does not reject everything.
    """
    n = points.shape[0]
    R, t = R0.copy(), t0.copy()
    w = np.ones(n)
    H = np.zeros((6, 6))
    g = np.zeros(6)
    drift = np.zeros(6)
    J = np.zeros((2, 6))
    squared = np.empty(n)
    res = np.empty((n, 2))
    cam = np.empty((n, 3))
    sigma = sigma_min
    for iteration in range(iterations):
        m = 0
        for i in range(n):
            for r in range(3):
                cam[i, r] = R[r, 0] * points[i, 0] + R[r, 1] * points[i, 1] + R[r, 2] * points[i, 2] + t[r]
            if cam[i, 2] > 1e-6:
                res[i, 0] = (observed[i, 0] - K[0] * cam[i, 0] / cam[i, 2] - K[2]) * weight[i]
                res[i, 1] = (observed[i, 1] - K[1] * cam[i, 1] / cam[i, 2] - K[3]) * weight[i]
                squared[m] = res[i, 0] * res[i, 0] + res[i, 1] * res[i, 1]
                m += 1
        sigma = tukey_sigma(squared, m, sigma_min)
        if iteration < iterations // 3:
            sigma = max(sigma, 3.0)
        limit = TUKEY * TUKEY * sigma * sigma
        H[:, :] = 0.0
        g[:] = 0.0
        for i in range(n):
            w[i] = 0.0
            if cam[i, 2] <= 1e-6:
                continue
            e = res[i, 0] * res[i, 0] + res[i, 1] * res[i, 1]
            if e >= limit:
                continue
            root = 1.0 - e / limit
            w[i] = root * root
            point_jacobian(K, cam[i, 0], cam[i, 1], cam[i, 2], J)
            scale = w[i] * weight[i]
            for a in range(6):
                g[a] += scale * (J[0, a] * res[i, 0] + J[1, a] * res[i, 1])
                for b in range(a, 6):
                    H[a, b] += scale * weight[i] * (J[0, a] * J[0, b] + J[1, a] * J[1, b])
        A = H.copy()
        step = g.copy()
        s2 = sigma * sigma
        for a in range(6):
            A[a, a] += prior_information[a] * s2 + 1e-9
            step[a] -= prior_information[a] * s2 * drift[a]
        if not factor_in_place(A):
            break
        solve_factored(A, step)
        for a in range(6):
            drift[a] += step[a]
        dR, dt = exp_se3(step)
        R, t = compose(dR, dt, R, t)
        if iteration > iterations // 3 and np.abs(step).max() < 1e-7:
            break
    orthonormalize(R)
    for a in range(6):
        for b in range(a + 1, 6):
            H[b, a] = H[a, b]
    return R, t, w, H / (sigma * sigma), sigma
