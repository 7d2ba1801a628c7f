"""Bundle adjustment: Levenberg-Marquardt on the reduced camera system (Schur complement), Tukey weights with the scale
re-estimated at every linearisation, relative-pose factors between frames (wheel odometry) and the floor under them.

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world; points additively. Only free frames are moved.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.floor import add_floor, floor_cost, hold_anchor
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
from vsx_ros.kernels.relative_pose import add_factors, factor_cost


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
    e: Any,
    sigma: float,
    R: Any,
    t: Any,
    factor_a: Any,
    factor_b: Any,
    factor_R: Any,
    factor_t: Any,
    factor_info: Any,
    floor: Any,
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
    total += factor_cost(R, t, factor_a, factor_b, factor_R, factor_t, factor_info)
    return total + floor_cost(R, t, floor)


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
    floor: Any,
    iterations: int,
    sigma_min: float,
) -> tuple[Any, Any, Any, Any, float, int]:
    """Refine frames T_cam_world (R0 (F, 3, 3), t0 (F, 3)) and points0 (M, 3).

    free (F,): 0..n-1 for frames that move, in ascending order, -1 for fixed ones. Observations are sorted by point
    (obs_start (M + 1,)) and within a point by frame; obs_xy (O, 2) undistorted px, obs_weight (O,) = 2^-level.
    Factors (E,): T_a_b measured as factor_R, factor_t with information factor_info (E, 6, 6).
    floor: see ``kernels.floor.Floor``.
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
            cost = _cost(e, sigma, R, t, factor_a, factor_b, factor_R, factor_t, factor_info, floor)
            _point_blocks(K, R, t, free, points, obs_start, obs_frame, obs_weight, res, e, sigma, H, g, V, gp, W)
        S, rhs = np.zeros((n, n)), g.copy()
        for i in range(n_free):
            for a in range(6):
                for b in range(a, 6):
                    S[6 * i + a, 6 * i + b] = H[i, a, b]
        add_factors(S, rhs, R, t, free, factor_a, factor_b, factor_R, factor_t, factor_info)
        add_floor(S, rhs, R, t, free, floor)
        for k in range(n):
            S[k, k] = S[k, k] * (1.0 + damping) + 1e-9
        hold_anchor(S, R, free, floor)
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
            new_cost = _cost(e_new, sigma, R_new, t_new, factor_a, factor_b, factor_R, factor_t, factor_info, floor)
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
