"""Bundle adjustment: Levenberg-Marquardt on the reduced camera system (Schur complement), Tukey weights with the scale
re-estimated at every linearisation, relative-pose factors between frames (wheel odometry) and the floor under them.

Perturbation as in ``pose``: T_cam_world <- exp(xi) T_cam_world; points additively. Only free frames are moved."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry import compose, exp_se3, orthonormalize
from vsx_ros.kernels.linalg.frontal import solve
from vsx_ros.kernels.slam.factors import Factors, Floor, add_factors, add_floor, factor_cost, floor_cost, hold_anchor
from vsx_ros.kernels.slam.pose import TUKEY, add_observation, tukey_sigma
from vsx_ros.kernels.slam.schur import (
    Blocks,
    BundleObservations,
    Pattern,
    back_substitute,
    pattern_of,
    reduce_points,
    room_for,
)


class Progress(NamedTuple):
    """State of an adjustment: damping of the next step, its growth when that step fails, and whether the adjustment is
    finished."""

    damping: float
    growth: float
    done: bool


START = Progress(1e-4, 2.0, False)
# A step that lowers the cost by a smaller share is the last.
LEAST_GAIN = 1e-4


class Estimate(NamedTuple):
    """T_cam_world of F frames: R (F, 3, 3), t (F, 3); points (M, 3); weighted residuals (O, 2) of the observations and
    their squares (O,), infinite behind the camera."""

    R: FloatArray
    t: FloatArray
    points: FloatArray
    residuals: FloatArray
    squares: FloatArray


@kernel
def fill_residuals(K: FloatArray, now: Estimate, observed: BundleObservations) -> None:
    """Fill the residuals and squares of an estimate; residuals behind the camera stay unchanged."""
    R, t, points, res, e = now
    for o in range(e.shape[0]):
        f, p = observed.frame[o], observed.point[o]
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        z = R[f, 2, 0] * X + R[f, 2, 1] * Y + R[f, 2, 2] * Z + t[f, 2]
        if z <= 1e-6:
            e[o] = np.inf
            continue
        x = R[f, 0, 0] * X + R[f, 0, 1] * Y + R[f, 0, 2] * Z + t[f, 0]
        y = R[f, 1, 0] * X + R[f, 1, 1] * Y + R[f, 1, 2] * Z + t[f, 1]
        res[o, 0] = (observed.xy[o, 0] - K[0] * x / z - K[2]) * observed.weight[o]
        res[o, 1] = (observed.xy[o, 1] - K[1] * y / z - K[3]) * observed.weight[o]
        e[o] = res[o, 0] * res[o, 0] + res[o, 1] * res[o, 1]


@kernel
def cost_of(now: Estimate, sigma: float, factors: Factors, floor: Floor) -> float:
    """Half the robust squared error in units of sigma."""
    limit = TUKEY * TUKEY * sigma * sigma
    worst = TUKEY * TUKEY / 6.0
    total = 0.0
    for square in now.squares:
        root = 1.0 - square / limit
        total += worst * (1.0 - root * root * root) if square < limit else worst
    return total + factor_cost(now.R, now.t, factors) + floor_cost(now.R, now.t, floor)


@kernel
def linearise(
    K: FloatArray, now: Estimate, number: IntArray, observed: BundleObservations, sigma: float, linear: Blocks
) -> None:
    """Fill all blocks but L."""
    R, t, points, res, e = now
    H, g, V, gp, W, _ = linear
    limit, inverse_variance = TUKEY * TUKEY * sigma * sigma, 1.0 / (sigma * sigma)
    H[:, :, :] = 0.0
    g[:, :] = 0.0
    for p in range(points.shape[0]):
        X, Y, Z = points[p, 0], points[p, 1], points[p, 2]
        v0 = v1 = v2 = v3 = v4 = v5 = g0 = g1 = g2 = 0.0
        for o in range(observed.start[p], observed.start[p + 1]):
            W[o, 0, 0] = np.nan
            if e[o] >= limit:
                continue
            f = observed.frame[o]
            root, weight = 1.0 - e[o] / limit, observed.weight[o]
            scale = root * root * inverse_variance * weight
            wu, wv = scale * res[o, 0], scale * res[o, 1]
            scale *= weight
            iz = 1.0 / (R[f, 2, 0] * X + R[f, 2, 1] * Y + R[f, 2, 2] * Z + t[f, 2])
            x = (R[f, 0, 0] * X + R[f, 0, 1] * Y + R[f, 0, 2] * Z + t[f, 0]) * iz
            y = (R[f, 1, 0] * X + R[f, 1, 1] * Y + R[f, 1, 2] * Z + t[f, 1]) * iz
            # Derivatives of u and v by the point in the world: one row each.
            a0, a2, b1, b2 = K[0] * iz, -K[0] * iz * x, K[1] * iz, -K[1] * iz * y
            p0, q0 = a0 * R[f, 0, 0] + a2 * R[f, 2, 0], b1 * R[f, 1, 0] + b2 * R[f, 2, 0]
            p1, q1 = a0 * R[f, 0, 1] + a2 * R[f, 2, 1], b1 * R[f, 1, 1] + b2 * R[f, 2, 1]
            p2, q2 = a0 * R[f, 0, 2] + a2 * R[f, 2, 2], b1 * R[f, 1, 2] + b2 * R[f, 2, 2]
            v0 += scale * (p0 * p0 + q0 * q0)
            v1 += scale * (p0 * p1 + q0 * q1)
            v2 += scale * (p0 * p2 + q0 * q2)
            v3 += scale * (p1 * p1 + q1 * q1)
            v4 += scale * (p1 * p2 + q1 * q2)
            v5 += scale * (p2 * p2 + q2 * q2)
            g0 += p0 * wu + q0 * wv
            g1 += p1 * wu + q1 * wv
            g2 += p2 * wu + q2 * wv
            i = number[f]
            if i < 0:
                continue
            add_observation(K, x, y, iz, wu, wv, scale, H[i], g[i])
            a3, a4, a5 = -K[0] * x * y, K[0] * (1.0 + x * x), -K[0] * y
            b3, b4, b5 = -K[1] * (1.0 + y * y), K[1] * x * y, K[1] * x
            for k in range(3):
                u, v = (p0, q0) if k == 0 else (p1, q1) if k == 1 else (p2, q2)
                u, v = scale * u, scale * v
                W[o, k, 0] = a0 * u
                W[o, k, 1] = b1 * v
                W[o, k, 2] = a2 * u + b2 * v
                W[o, k, 3] = a3 * u + b3 * v
                W[o, k, 4] = a4 * u + b4 * v
                W[o, k, 5] = a5 * u + b5 * v
        V[p, 0], V[p, 1], V[p, 2], V[p, 3], V[p, 4], V[p, 5] = v0, v1, v2, v3, v4, v5
        gp[p, 0], gp[p, 1], gp[p, 2] = g0, g1, g2


@kernel
def _system(
    pattern: Pattern, now: Estimate, factors: Factors, floor: Floor, H: FloatArray, damping: float, blocks: FloatArray,
    rhs: FloatArray,
) -> None:  # fmt: skip
    """Fill blocks with the frames' own part of the system, damped; add the factors' and the floor's to rhs."""
    blocks[:, :, :] = 0.0
    for i in range(H.shape[0]):
        for a in range(6):
            for b in range(a, 6):
                blocks[pattern.begin[i], a, b] = H[i, a, b]
    add_factors(blocks, rhs, now.R, now.t, pattern, factors)
    add_floor(blocks, rhs, now.R, now.t, pattern, floor)
    for i in range(H.shape[0]):
        diagonal = blocks[pattern.begin[i]]
        for a in range(6):
            diagonal[a, a] = diagonal[a, a] * (1.0 + damping) + 1e-9
    hold_anchor(blocks, now.R, pattern, floor)


@kernel
def _move(number: IntArray, step: FloatArray, now: Estimate, trial: Estimate) -> None:
    """Fill the free frames of trial with those of now after their step (n, 6)."""
    for f in range(number.shape[0]):
        if number[f] >= 0:
            dR, dt = exp_se3(step[number[f]])
            trial.R[f], trial.t[f] = compose(dR, dt, now.R[f], now.t[f])


@kernel
def adjust(
    K: FloatArray, R0: FloatArray, t0: FloatArray, free: IntArray, points0: FloatArray, observed: BundleObservations,
    factors: Factors, floor: Floor, iterations: int, sigma_min: float, progress: Progress,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, int, Progress]:  # fmt: skip
    """Refine frames T_cam_world (R0 (F, 3, 3), t0 (F, 3)) and points0 (M, 3).

    free (F,): 0..n-1 for frames that move, -1 for fixed ones. progress: START, or that of an earlier call to continue.
    Returns R, t, points, squared weighted residuals (O,), sigma [px], accepted steps, progress. Makes at most
    ``iterations`` trials."""
    pattern = pattern_of(free, observed, factors.a, factors.b)
    n_obs = observed.frame.shape[0]
    now = Estimate(
        R=R0.copy(), t=t0.copy(), points=points0.copy(), residuals=np.zeros((n_obs, 2)), squares=np.empty(n_obs)
    )
    trial = Estimate(
        R=R0.copy(), t=t0.copy(), points=points0.copy(), residuals=np.zeros((n_obs, 2)), squares=np.empty(n_obs)
    )
    linear = room_for(pattern.extent.shape[0], points0.shape[0], n_obs)
    blocks = np.empty((pattern.column.shape[0], 6, 6))
    fill_residuals(K, now, observed)
    damping, growth, done = progress
    linear_here, accepted, sigma, cost = False, 0, sigma_min, 0.0
    for _ in range(iterations):
        if done:
            break
        if not linear_here:
            sigma = tukey_sigma(now.squares, n_obs, sigma_min)
            cost = cost_of(now, sigma, factors, floor)
            linearise(K, now, pattern.number, observed, sigma, linear)
        step = linear.g.copy()
        _system(pattern, now, factors, floor, linear.H, damping, blocks, step)
        reduce_points(pattern, observed, linear, damping, blocks, step)
        new_cost = np.inf
        if solve(blocks, pattern.begin, pattern.column, pattern.entry, pattern.extent, step):
            _move(pattern.number, step, now, trial)
            back_substitute(pattern.number, observed, linear, step, now.points, trial.points)
            fill_residuals(K, trial, observed)
            new_cost = cost_of(trial, sigma, factors, floor)
        linear_here = not new_cost < cost
        if linear_here:
            damping, growth = damping * growth, growth * 2.0
            done = damping > 1e8
        else:
            now, trial = trial, now
            done = cost - new_cost < LEAST_GAIN * cost
            damping, growth, accepted = max(1e-9, damping * 0.3), 2.0, accepted + 1
    for f in range(free.shape[0]):
        orthonormalize(now.R[f])
    sigma = tukey_sigma(now.squares, n_obs, sigma_min)
    return now.R, now.t, now.points, now.squares, sigma, accepted, Progress(damping, growth, done)
