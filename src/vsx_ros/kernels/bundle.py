"""Bundle adjustment: Levenberg-Marquardt on the reduced camera system (Schur complement), Tukey weights with the scale
re-estimated at every linearisation, and relative-pose factors between frames (wheel odometry).

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world; points additively. Only free frames are moved.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.pose import (
    TUKEY,
    compose,
    exp_se3,
    factor_in_place,
    orthonormalize,
    point_jacobian,
    solve_factored,
    tukey_sigma,
)

HUBER = 5.0


@kernel
def log_se3(R: Any, t: Any) -> Any:
    """Tangent vector (6,) of a rigid motion whose rotation stays well below pi."""
    xi = np.empty(6)
    sx, sy, sz = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(sx * sx + sy * sy + sz * sz)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    k = 1.0 if sine < 1e-9 else angle / sine
    wx, wy, wz = k * sx, k * sy, k * sz
    if angle < 1e-5:
        c = 1.0 / 12.0
    else:
        c = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    cx, cy, cz = wy * t[2] - wz * t[1], wz * t[0] - wx * t[2], wx * t[1] - wy * t[0]
    xi[0] = t[0] - 0.5 * cx + c * (wy * cz - wz * cy)
    xi[1] = t[1] - 0.5 * cy + c * (wz * cx - wx * cz)
    xi[2] = t[2] - 0.5 * cz + c * (wx * cy - wy * cx)
    xi[3], xi[4], xi[5] = wx, wy, wz
    return xi


@kernel
def relative_residual(Ra: Any, ta: Any, Rb: Any, tb: Any, Zr: Any, zt: Any) -> Any:
    """(6,) log(Z^-1 T_a_world T_b_world^-1): how far two frames are from their measured relative pose Z = T_a_b."""
    Rab = np.empty((3, 3))
    tab = np.empty(3)
    for i in range(3):
        for j in range(3):
            Rab[i, j] = Ra[i, 0] * Rb[j, 0] + Ra[i, 1] * Rb[j, 1] + Ra[i, 2] * Rb[j, 2]
    for i in range(3):
        tab[i] = ta[i] - (Rab[i, 0] * tb[0] + Rab[i, 1] * tb[1] + Rab[i, 2] * tb[2]) - zt[i]
    E = np.empty((3, 3))
    e = np.empty(3)
    for i in range(3):
        for j in range(3):
            E[i, j] = Zr[0, i] * Rab[0, j] + Zr[1, i] * Rab[1, j] + Zr[2, i] * Rab[2, j]
        e[i] = Zr[0, i] * tab[0] + Zr[1, i] * tab[1] + Zr[2, i] * tab[2]
    return log_se3(E, e)


@kernel
def _bracket(xi: Any, factor: float) -> Any:
    """(6, 6) identity + factor * ad(xi)."""
    A = np.zeros((6, 6))
    for block in range(2):
        o = 3 * block
        A[o, o + 1], A[o, o + 2] = -xi[5], xi[4]
        A[o + 1, o], A[o + 1, o + 2] = xi[5], -xi[3]
        A[o + 2, o], A[o + 2, o + 1] = -xi[4], xi[3]
    A[0, 4], A[0, 5] = -xi[2], xi[1]
    A[1, 3], A[1, 5] = xi[2], -xi[0]
    A[2, 3], A[2, 4] = -xi[1], xi[0]
    for i in range(6):
        for j in range(6):
            A[i, j] *= factor
        A[i, i] += 1.0
    return A


@kernel
def relative_jacobians(xi: Any, Zr: Any, zt: Any) -> tuple[Any, Any]:
    """(6, 6) derivatives of ``relative_residual`` (value xi) by the perturbations of frames a and b, second order in
    xi."""
    left = _bracket(xi, -0.5)
    right = _bracket(xi, 0.5)
    adjoint = np.zeros((6, 6))
    s = np.array(
        [
            Zr[0, 0] * zt[0] + Zr[1, 0] * zt[1] + Zr[2, 0] * zt[2],
            Zr[0, 1] * zt[0] + Zr[1, 1] * zt[1] + Zr[2, 1] * zt[2],
            Zr[0, 2] * zt[0] + Zr[1, 2] * zt[1] + Zr[2, 2] * zt[2],
        ]
    )
    for i in range(3):
        for j in range(3):
            adjoint[i, j] = Zr[j, i]
            adjoint[3 + i, 3 + j] = Zr[j, i]
    for j in range(3):
        c0, c1, c2 = Zr[j, 0], Zr[j, 1], Zr[j, 2]
        adjoint[0, 3 + j] = -(s[1] * c2 - s[2] * c1)
        adjoint[1, 3 + j] = -(s[2] * c0 - s[0] * c2)
        adjoint[2, 3 + j] = -(s[0] * c1 - s[1] * c0)
    Ja = np.zeros((6, 6))
    for i in range(6):
        for k in range(6):
            for j in range(6):
                Ja[i, j] += left[i, k] * adjoint[k, j]
    return Ja, -right


@kernel
def _residuals(
    K: Any, R: Any, t: Any, points: Any, obs_point: Any, obs_frame: Any, obs_xy: Any, obs_weight: Any, res: Any, e: Any
) -> None:
    """Fill weighted residuals (O, 2) and their squares (O,); behind the camera: infinite square."""
    for o in range(obs_frame.shape[0]):
        f, p = obs_frame[o], obs_point[o]
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        z = R[f, 2, 0] * X + R[f, 2, 1] * Y + R[f, 2, 2] * Z + t[f, 2]
        if z <= 1e-6:
            e[o] = np.inf
            continue
        x = R[f, 0, 0] * X + R[f, 0, 1] * Y + R[f, 0, 2] * Z + t[f, 0]
        y = R[f, 1, 0] * X + R[f, 1, 1] * Y + R[f, 1, 2] * Z + t[f, 1]
        res[o, 0] = (obs_xy[o, 0] - K[0] * x / z - K[2]) * obs_weight[o]
        res[o, 1] = (obs_xy[o, 1] - K[1] * y / z - K[3]) * obs_weight[o]
        e[o] = res[o, 0] * res[o, 0] + res[o, 1] * res[o, 1]


@kernel
def _cost(
    e: Any, sigma: float, R: Any, t: Any, factor_a: Any, factor_b: Any, factor_R: Any, factor_t: Any, factor_info: Any
) -> float:
    """Half the robust squared error in units of sigma."""
    limit = TUKEY * TUKEY * sigma * sigma
    worst = TUKEY * TUKEY / 6.0
    total = 0.0
    for o in range(e.shape[0]):
        if e[o] >= limit:
            total += worst
        else:
            root = 1.0 - e[o] / limit
            total += worst * (1.0 - root * root * root)
    for f in range(factor_a.shape[0]):
        a, b = factor_a[f], factor_b[f]
        r = relative_residual(R[a], t[a], R[b], t[b], factor_R[f], factor_t[f])
        m = math.sqrt(max(0.0, _quadratic(r, factor_info[f])))
        total += 0.5 * m * m if m <= HUBER else HUBER * (m - 0.5 * HUBER)
    return total


@kernel
def _quadratic(r: Any, info: Any) -> float:
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += r[i] * info[i, j] * r[j]
    return total


@kernel
def _add_factors(
    S: Any,
    g: Any,
    R: Any,
    t: Any,
    free: Any,
    factor_a: Any,
    factor_b: Any,
    factor_R: Any,
    factor_t: Any,
    factor_info: Any,
) -> None:
    """Add the relative-pose factors to the upper triangle of the reduced system S and its right-hand side g."""
    for f in range(factor_a.shape[0]):
        a, b = factor_a[f], factor_b[f]
        r = relative_residual(R[a], t[a], R[b], t[b], factor_R[f], factor_t[f])
        m = math.sqrt(max(0.0, _quadratic(r, factor_info[f])))
        info = factor_info[f] * (1.0 if m <= HUBER else HUBER / m)
        Ja, Jb = relative_jacobians(r, factor_R[f], factor_t[f])
        for first in range(2):
            J1 = Ja if first == 0 else Jb
            i = free[a] if first == 0 else free[b]
            if i < 0:
                continue
            JI = J1.T @ info
            rhs = JI @ r
            for k in range(6):
                g[6 * i + k] -= rhs[k]
            for second in range(2):
                J2 = Ja if second == 0 else Jb
                j = free[a] if second == 0 else free[b]
                if j < i:
                    continue
                block = JI @ J2
                for k in range(6):
                    for m2 in range(6):
                        S[6 * i + k, 6 * j + m2] += block[k, m2]


@kernel
def _point_blocks(
    K: Any,
    R: Any,
    t: Any,
    free: Any,
    points: Any,
    obs_start: Any,
    obs_frame: Any,
    obs_weight: Any,
    res: Any,
    e: Any,
    sigma: float,
    H: Any,
    g: Any,
    V: Any,
    gp: Any,
    W: Any,
) -> None:
    """Linearise: frame blocks H (upper), g; point blocks V (M, 6), gp (M, 3); mixed blocks W (O, 6, 3)."""
    limit = TUKEY * TUKEY * sigma * sigma
    inverse_variance = 1.0 / (sigma * sigma)
    J = np.empty((2, 6))
    P = np.empty((2, 3))
    H[:, :, :] = 0.0
    g[:] = 0.0
    for p in range(points.shape[0]):
        for k in range(6):
            V[p, k] = 0.0
        for k in range(3):
            gp[p, k] = 0.0
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        for o in range(obs_start[p], obs_start[p + 1]):
            f = obs_frame[o]
            W[o, 0, 0] = np.nan
            if e[o] >= limit:
                continue
            root = 1.0 - e[o] / limit
            w = root * root * inverse_variance * obs_weight[o]
            x = R[f, 0, 0] * X + R[f, 0, 1] * Y + R[f, 0, 2] * Z + t[f, 0]
            y = R[f, 1, 0] * X + R[f, 1, 1] * Y + R[f, 1, 2] * Z + t[f, 1]
            z = R[f, 2, 0] * X + R[f, 2, 1] * Y + R[f, 2, 2] * Z + t[f, 2]
            point_jacobian(K, x, y, z, J)
            for r in range(2):
                for k in range(3):
                    P[r, k] = J[r, 0] * R[f, 0, k] + J[r, 1] * R[f, 1, k] + J[r, 2] * R[f, 2, k]
            ww = w * obs_weight[o]
            r0, r1 = w * res[o, 0], w * res[o, 1]
            V[p, 0] += ww * (P[0, 0] * P[0, 0] + P[1, 0] * P[1, 0])
            V[p, 1] += ww * (P[0, 0] * P[0, 1] + P[1, 0] * P[1, 1])
            V[p, 2] += ww * (P[0, 0] * P[0, 2] + P[1, 0] * P[1, 2])
            V[p, 3] += ww * (P[0, 1] * P[0, 1] + P[1, 1] * P[1, 1])
            V[p, 4] += ww * (P[0, 1] * P[0, 2] + P[1, 1] * P[1, 2])
            V[p, 5] += ww * (P[0, 2] * P[0, 2] + P[1, 2] * P[1, 2])
            for k in range(3):
                gp[p, k] += P[0, k] * r0 + P[1, k] * r1
            i = free[f]
            if i < 0:
                continue
            for a in range(6):
                j0, j1 = J[0, a], J[1, a]
                g[6 * i + a] += j0 * r0 + j1 * r1
                for b in range(a, 6):
                    H[i, a, b] += ww * (j0 * J[0, b] + j1 * J[1, b])
                for k in range(3):
                    W[o, a, k] = ww * (j0 * P[0, k] + j1 * P[1, k])


@kernel
def _invert_symmetric(V: Any, damping: float, out: Any) -> bool:
    """Inverse (6 upper entries) of a damped symmetric 3x3; False when it is singular."""
    a, b, c = V[0] * (1.0 + damping) + 1e-12, V[1], V[2]
    d, e, f = V[3] * (1.0 + damping) + 1e-12, V[4], V[5] * (1.0 + damping) + 1e-12
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * c00 + b * c01 + c * c02
    if not det > 1e-30 * a * d * f:
        return False
    out[0], out[1], out[2] = c00 / det, c01 / det, c02 / det
    out[3], out[4], out[5] = (a * f - c * c) / det, (b * c - a * e) / det, (a * d - b * b) / det
    return True


@kernel
def _reduce(
    free: Any, obs_start: Any, obs_frame: Any, V: Any, gp: Any, W: Any, damping: float, S: Any, rhs: Any, Vi: Any
) -> None:
    """Subtract the points' share from the upper triangle of S and from rhs; keep the inverted point blocks Vi (M,
    6)."""
    Y = np.empty((6, 3))
    for p in range(V.shape[0]):
        if not _invert_symmetric(V[p], damping, Vi[p]):
            Vi[p, 0] = np.nan
            continue
        v0, v1, v2, v3, v4, v5 = Vi[p, 0], Vi[p, 1], Vi[p, 2], Vi[p, 3], Vi[p, 4], Vi[p, 5]
        for o in range(obs_start[p], obs_start[p + 1]):
            i = free[obs_frame[o]]
            if i < 0 or np.isnan(W[o, 0, 0]):
                continue
            for a in range(6):
                w0, w1, w2 = W[o, a, 0], W[o, a, 1], W[o, a, 2]
                Y[a, 0] = w0 * v0 + w1 * v1 + w2 * v2
                Y[a, 1] = w0 * v1 + w1 * v3 + w2 * v4
                Y[a, 2] = w0 * v2 + w1 * v4 + w2 * v5
                rhs[6 * i + a] -= Y[a, 0] * gp[p, 0] + Y[a, 1] * gp[p, 1] + Y[a, 2] * gp[p, 2]
            for q in range(o, obs_start[p + 1]):
                j = free[obs_frame[q]]
                if j < 0 or np.isnan(W[q, 0, 0]):
                    continue
                for a in range(6):
                    y0, y1, y2 = Y[a, 0], Y[a, 1], Y[a, 2]
                    for b in range(6):
                        S[6 * i + a, 6 * j + b] -= y0 * W[q, b, 0] + y1 * W[q, b, 1] + y2 * W[q, b, 2]


@kernel
def _back_substitute(
    free: Any, obs_start: Any, obs_frame: Any, gp: Any, W: Any, Vi: Any, step: Any, points: Any, moved: Any
) -> None:
    """Fill moved (M, 3): points after the step that belongs to the frames' step."""
    for p in range(points.shape[0]):
        b0, b1, b2 = gp[p, 0], gp[p, 1], gp[p, 2]
        for o in range(obs_start[p], obs_start[p + 1]):
            i = free[obs_frame[o]]
            if i < 0 or np.isnan(W[o, 0, 0]):
                continue
            for a in range(6):
                s = step[6 * i + a]
                b0 -= W[o, a, 0] * s
                b1 -= W[o, a, 1] * s
                b2 -= W[o, a, 2] * s
        if np.isnan(Vi[p, 0]):
            moved[p, 0], moved[p, 1], moved[p, 2] = points[p, 0], points[p, 1], points[p, 2]
            continue
        moved[p, 0] = points[p, 0] + Vi[p, 0] * b0 + Vi[p, 1] * b1 + Vi[p, 2] * b2
        moved[p, 1] = points[p, 1] + Vi[p, 1] * b0 + Vi[p, 3] * b1 + Vi[p, 4] * b2
        moved[p, 2] = points[p, 2] + Vi[p, 2] * b0 + Vi[p, 4] * b1 + Vi[p, 5] * b2


@kernel
def adjust(
    K: Any,
    R0: Any,
    t0: Any,
    free: Any,
    points0: Any,
    obs_start: Any,
    obs_point: Any,
    obs_frame: Any,
    obs_xy: Any,
    obs_weight: Any,
    factor_a: Any,
    factor_b: Any,
    factor_R: Any,
    factor_t: Any,
    factor_info: Any,
    iterations: int,
    sigma_min: float,
) -> tuple[Any, Any, Any, Any, float, int]:
    """Refine frames T_cam_world (R0 (F, 3, 3), t0 (F, 3)) and points0 (M, 3).

    free (F,): 0..n-1 for frames that move, in ascending order, -1 for fixed ones. Observations are sorted by point
    (obs_start (M + 1,)) and within a point by frame; obs_xy (O, 2) undistorted px, obs_weight (O,) = 2^-level.
    Factors (E,): T_a_b measured as factor_R, factor_t with information factor_info (E, 6, 6).
    Returns R, t, points, squared weighted residuals (O,), sigma [px], accepted steps. At most ``iterations``
    trials, whatever happens.
    """
    R, t, points = R0.copy(), t0.copy(), points0.copy()
    n_free = 0
    for f in range(free.shape[0]):
        n_free = max(n_free, free[f] + 1)
    n, m, n_obs = 6 * n_free, points.shape[0], obs_frame.shape[0]
    res, e = np.zeros((n_obs, 2)), np.empty(n_obs)
    H, g = np.zeros((n_free, 6, 6)), np.zeros(n)
    V, Vi, gp = np.zeros((m, 6)), np.zeros((m, 6)), np.zeros((m, 3))
    W = np.zeros((n_obs, 6, 3))
    R_new, t_new, moved = R.copy(), t.copy(), points.copy()
    res_new, e_new = np.zeros((n_obs, 2)), np.empty(n_obs)
    _residuals(K, R, t, points, obs_point, obs_frame, obs_xy, obs_weight, res, e)
    damping, growth = 1e-4, 2.0
    linearise = True
    accepted, small = 0, 0
    sigma, cost = sigma_min, 0.0
    for _ in range(iterations):
        if linearise:
            sigma = tukey_sigma(e, n_obs, sigma_min)
            cost = _cost(e, sigma, R, t, factor_a, factor_b, factor_R, factor_t, factor_info)
            _point_blocks(K, R, t, free, points, obs_start, obs_frame, obs_weight, res, e, sigma, H, g, V, gp, W)
        S, rhs = np.zeros((n, n)), g.copy()
        for i in range(n_free):
            for a in range(6):
                for b in range(a, 6):
                    S[6 * i + a, 6 * i + b] = H[i, a, b]
        _add_factors(S, rhs, R, t, free, factor_a, factor_b, factor_R, factor_t, factor_info)
        for k in range(n):
            S[k, k] = S[k, k] * (1.0 + damping) + 1e-9
        _reduce(free, obs_start, obs_frame, V, gp, W, damping, S, rhs, Vi)
        solved = factor_in_place(S)
        new_cost = np.inf
        if solved:
            solve_factored(S, rhs)
            for f in range(free.shape[0]):
                if free[f] >= 0:
                    dR, dt = exp_se3(rhs[6 * free[f] : 6 * free[f] + 6])
                    R_new[f], t_new[f] = compose(dR, dt, R[f], t[f])
            _back_substitute(free, obs_start, obs_frame, gp, W, Vi, rhs, points, moved)
            _residuals(K, R_new, t_new, moved, obs_point, obs_frame, obs_xy, obs_weight, res_new, e_new)
            new_cost = _cost(e_new, sigma, R_new, t_new, factor_a, factor_b, factor_R, factor_t, factor_info)
        if new_cost < cost:
            gain = (cost - new_cost) / cost
            R[:], t[:], points[:], res[:], e[:] = R_new, t_new, moved, res_new, e_new
            damping, growth = max(1e-9, damping * 0.3), 2.0
            accepted += 1
            linearise = True
            small = small + 1 if gain < 1e-5 else 0
            if small >= 2:
                break
        else:
            damping, growth = damping * growth, growth * 2.0
            linearise = False
            if damping > 1e8:
                break
    for f in range(free.shape[0]):
        orthonormalize(R[f])
    sigma = tukey_sigma(e, n_obs, sigma_min)
    return R, t, points, e, sigma, accepted
