"""Points eliminated and put back: the same step as from the whole system, points and frames together."""

import numpy as np
import pytest

from vsx_ros.kernels.linalg import frontal
from vsx_ros.kernels.slam import schur
from vsx_ros.kernels.slam.factors import no_factors

N, M = 4, 30


def observed(start, frame):
    n = len(frame)
    return schur.BundleObservations(
        start, np.repeat(np.arange(len(start) - 1), np.diff(start)), frame, np.zeros((n, 2)), np.ones(n)
    )


def linearised(V, gp, W):
    return schur.Blocks(np.zeros((N, 6, 6)), np.zeros((N, 6)), V, gp, W, np.zeros((len(V), 6)))


def test_step_is_that_of_the_whole_system():
    rng, damping = np.random.default_rng(0), 1e-3
    free = np.array([-1, 0, 1, 2, 3])
    seen = rng.random((M, N + 1)) < 0.6
    seen[:, :2] = True
    point, frame = np.nonzero(seen)
    start = np.searchsorted(point, np.arange(M + 1))
    outlier = rng.random(len(point)) < 0.1
    A, B = rng.normal(size=(len(point), 2, 6)), rng.normal(size=(len(point), 2, 3))
    r = rng.normal(size=(len(point), 2))
    A[outlier], B[outlier] = 0.0, 0.0
    J = np.zeros((2 * len(point), 6 * N + 3 * M))
    for o in range(len(point)):
        rows = slice(2 * o, 2 * o + 2)
        if free[frame[o]] >= 0:
            J[rows, 6 * free[frame[o]] : 6 * free[frame[o]] + 6] = A[o]
        J[rows, 6 * N + 3 * point[o] : 6 * N + 3 * point[o] + 3] = B[o]
    whole, down = J.T @ J, J.T @ r.ravel()
    damped = whole + np.diag(damping * np.diag(whole) + np.r_[np.full(6 * N, 1e-9), np.full(3 * M, 1e-12)])
    expected = np.linalg.solve(damped, down)

    pattern = schur.pattern_of(free, observed(start, frame), no_factors().a, no_factors().b)
    at = pattern.number[1:]
    W = np.einsum("oir,oik->ork", B, A)
    W[outlier] = np.nan
    V = np.array([whole[6 * N + 3 * p :, 6 * N + 3 * p :][:3, :3][np.triu_indices(3)] for p in range(M)])
    gp, b = down[6 * N :].reshape(M, 3), np.zeros((N, 6))
    blocks, linear = np.zeros((len(pattern.column), 6, 6)), linearised(V, gp, W)
    for f in range(N):
        blocks[pattern.begin[at[f]]] = damped[6 * f : 6 * f + 6, 6 * f : 6 * f + 6]
        b[at[f]] = down[6 * f : 6 * f + 6]
    schur.reduce_points(pattern, observed(start, frame), linear, damping, blocks, b)
    assert frontal.solve(blocks, pattern.begin, pattern.column, pattern.entry, pattern.extent, b)
    points, moved = rng.normal(size=(M, 3)), np.empty((M, 3))
    schur.back_substitute(pattern.number, observed(start, frame), linear, b, points, moved)
    assert b[at].ravel() == pytest.approx(expected[: 6 * N], rel=1e-6, abs=1e-9)
    assert (moved - points).ravel() == pytest.approx(expected[6 * N :], rel=1e-6, abs=1e-9)


def test_pattern_has_blocks_where_points_or_factors_tie_frames():
    seen = observed(np.array([0, 2, 5]), np.array([0, 1, 1, 2, 3]))
    pattern = schur.pattern_of(np.array([-1, 0, 1, 2, 3]), seen, np.array([3]), np.array([4]))
    tied = {
        (min(a, b), max(a, b)) for a, b in ((1, 2), (1, 3), (2, 3), (3, 4)) for a, b in [sorted(pattern.number[[a, b]])]
    }
    found = {tuple(at) for at in np.argwhere(pattern.block >= 0).tolist() if at[0] != at[1]}
    assert found == tied
    assert pattern.number[0] == -1
    assert (pattern.column[pattern.begin[:-1]] == np.arange(4)).all()


def test_a_point_without_inliers_stays():
    seen = observed(np.array([0, 2]), np.array([0, 1]))
    pattern = schur.pattern_of(np.array([-1, 0]), seen, *no_factors()[:2])
    b, linear = np.ones((1, 6)), linearised(np.zeros((1, 6)), np.zeros((1, 3)), np.full((2, 3, 6), np.nan))
    blocks, points, moved = np.eye(6)[None].copy(), np.array([[1.0, 2.0, 3.0]]), np.empty((1, 3))
    schur.reduce_points(pattern, seen, linear, 1e-4, blocks, b)
    schur.back_substitute(pattern.number, seen, linear, b, points, moved)
    assert (blocks[0] == np.eye(6)).all()
    assert (moved == points).all()
