"""Pose graph: exact derivatives, exact factor, and the laws of a closed loop."""

import math

import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3, so3_exp
from vsx_ros.kernels.linalg.cholesky import envelope, factor_envelope, solve_envelope
from vsx_ros.kernels.slam.pose_graph import Edges, edge_jacobians, edge_residual, optimize_graph

RNG_SEED = 3


def similarity(rng, size=1.0):
    return so3_exp(rng.normal(0, size, 3)), rng.normal(0, 1, 3), math.exp(rng.normal(0, 0.3))


def perturbed(node, x):
    R, t, s = node
    return R @ so3_exp(x[3:6]), t + x[:3], s * math.exp(x[6])


def edge(a, b, z):
    """Two nodes as the kernels take them: (their rotations, translations, sizes), the edge that measured z."""
    one = np.zeros(1, np.int64)
    return tuple(map(np.array, zip(a, b))), Edges(
        one, one + 1, z[0][None], z[1][None], z[2] * np.ones(1), np.eye(7)[None]
    )


def residual(a, b, z):
    nodes, measured = edge(a, b, z)
    return edge_residual(*nodes, measured, 0)


@pytest.mark.parametrize("error", [0.0, 1e-5, 0.3, 1.5])
def test_jacobians_are_the_finite_differences(error):
    rng = np.random.default_rng(RNG_SEED)
    a, z = similarity(rng), similarity(rng)
    b = (a[0] @ z[0] @ so3_exp(error * np.array([0.6, 0.0, 0.8])), rng.normal(0, 1, 3), 1.7)
    (R, _, s), measured = edge(a, b, z)
    Ja, Jb = edge_jacobians(residual(a, b, z), R, s, measured, 0)
    for which, J in ((0, Ja), (1, Jb)):
        for k in range(7):
            ends = []
            for h in (1e-6, -1e-6):
                x = h * np.eye(7)[k]
                nodes = (perturbed(a, x), b) if which == 0 else (a, perturbed(b, x))
                ends.append(residual(*nodes, z))
            numeric = (ends[0] - ends[1]) / 2e-6
            assert J[:, k] == pytest.approx(numeric, abs=2e-6), (which, k)


def test_residual_vanishes_where_the_measurement_holds():
    rng = np.random.default_rng(RNG_SEED)
    (Ra, ta, sa), (Zr, zt, zs) = similarity(rng), similarity(rng)
    b = Ra @ Zr, ta + sa * Ra @ zt, sa * zs
    assert residual((Ra, ta, sa), b, (Zr, zt, zs)) == pytest.approx(np.zeros(7), abs=1e-12)


def test_envelope_solves_as_the_dense_matrix_does():
    rng = np.random.default_rng(RNG_SEED)
    n, D = 9, 3
    a, b = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 7, -1]), np.array([1, 2, 3, 4, 5, 6, 7, 8, 1, 3, 4])
    dense = np.zeros((n * D, n * D))
    for i, j in zip(a, b):
        if i < 0:
            continue
        J = np.zeros((D, n * D))
        J[:, i * D : i * D + D], J[:, j * D : j * D + D] = rng.normal(size=(D, D)), rng.normal(size=(D, D))
        dense += J.T @ J
    dense += 0.1 * np.eye(n * D)
    first, start = envelope(n, a, b)
    assert first.tolist() == [0, 0, 1, 2, 3, 4, 5, 3, 1]
    blocks = np.zeros((start[-1], D, D))
    for j in range(n):
        for i in range(first[j], j + 1):
            blocks[start[j] + i - first[j]] = dense[i * D : i * D + D, j * D : j * D + D]
    x = rng.normal(size=(n, D))
    wanted = np.linalg.solve(dense, x.ravel())
    assert factor_envelope(blocks, first, start)
    solve_envelope(blocks, first, start, x)
    assert x.ravel() == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    assert not factor_envelope(np.zeros_like(blocks), first, start)


def ring(n, step, turn_error, stretch):
    """A closed drive on a circle as drifting odometry tells it: true poses, believed poses, believed steps."""
    true = [SE3(so3_exp([0, 0, 2 * math.pi * k / n]), _on_circle(2 * math.pi * k / n, n * step)) for k in range(n)]
    steps = [true[k].inverse() @ true[k + 1] for k in range(n - 1)]
    wrong = SE3(so3_exp([0.0, 0.0, turn_error]), np.zeros(3))
    steps = [SE3(T.rotation, stretch * T.translation) @ wrong for T in steps]
    believed = [true[0]]
    for T in steps:
        believed.append(believed[-1] @ T)
    return true, believed, steps


def _on_circle(angle, circumference):
    radius = circumference / (2 * math.pi)
    return np.array([radius * math.sin(angle), radius * (1 - math.cos(angle)), 0.0])


def solve(believed, steps, loops, free_scale=False, loop_scale=1.0):
    n = len(believed)
    edges = [(k, k + 1, T, 1.0, 1.0) for k, T in enumerate(steps)]
    edges += [(a, b, T, 1e4, loop_scale) for a, b, T in loops]
    held = np.zeros(n, np.bool_)
    held[0] = True
    info = np.diag([1e4, 1e4, 1e4, 1e5, 1e5, 1e5, 1e4])
    return optimize_graph(
        np.array([T.rotation for T in believed]),
        np.array([T.translation for T in believed]),
        np.ones(n),
        held,
        Edges(
            np.array([e[0] for e in edges]),
            np.array([e[1] for e in edges]),
            np.array([e[2].rotation for e in edges]),
            np.array([e[2].translation for e in edges]),
            np.array([e[4] for e in edges]),
            np.array([e[3] * info for e in edges]),
        ),
        free_scale,
        30,
    )


def worst(true, t):
    return max(float(np.linalg.norm(T.translation - x)) for T, x in zip(true, t))


def test_closing_the_ring_takes_the_drift_out():
    true, believed, steps = ring(80, 0.25, 0.002, 1.0)
    before = worst(true, [T.translation for T in believed])
    R, t, s, cost = solve(believed, steps, [(0, 79, true[0].inverse() @ true[79])])
    assert before > 0.4
    assert worst(true, t) < 0.05 * before
    assert s == pytest.approx(np.ones(80))
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-9
    assert 0 < cost < 1e3


def test_nothing_moves_without_a_contradiction():
    true, _, steps = ring(40, 0.25, 0.0, 1.0)
    _, t, _, cost = solve(true, steps, [(0, 39, true[0].inverse() @ true[39])])
    assert worst(true, t) < 1e-9
    assert cost < 1e-12


def test_scale_drift_needs_free_scales():
    """Each step 1 % larger than the one before, as a single camera drifts; the loop says so in its scale."""
    true, _, _ = ring(60, 0.3, 0.0, 1.0)
    growth = 1.01
    believed, size = [true[0]], 1.0
    for k in range(59):
        T = true[k].inverse() @ true[k + 1]
        believed.append(believed[-1] @ SE3(T.rotation, size * T.translation))
        size *= growth
    steps = [believed[k].inverse() @ believed[k + 1] for k in range(59)]
    first = believed[0].inverse() @ true[59]
    # The scale of the last node's frame against the first one's.
    _, t, s, _ = solve(believed, steps, [(0, 59, first)], True, 1.0 / size)
    rigid = solve(believed, steps, [(0, 59, first)], False)[1]
    assert worst(true, t) < 0.25 * worst(true, [T.translation for T in believed])
    assert worst(true, t) < 0.5 * worst(true, rigid)
    assert s[-1] == pytest.approx(1.0 / size, rel=0.05)
    assert (np.diff(s) < 0).all()
