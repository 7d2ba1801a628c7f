"""Robust pose: derivatives, factorisation, recovery from outliers."""

import numpy as np
import pytest

from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels import geometry
from vsx_ros.kernels.linalg import cholesky
from vsx_ros.kernels.slam import pose

K = np.array([525.0, 520.0, 320.0, 240.0])


def pixels(T, points):
    cam = T @ points
    return cam[:, :2] / cam[:, 2:] * K[:2] + K[2:]


def test_exponential_is_se3s():
    rng = np.random.default_rng(0)
    for scale in (1e-7, 1e-3, 1.0, 3.0):
        xi = rng.normal(size=6)
        xi *= scale / np.linalg.norm(xi)
        R, t = geometry.exp_se3(xi)
        assert np.allclose(R, SE3.exp(xi).rotation, atol=1e-12)
        assert np.allclose(t, SE3.exp(xi).translation, atol=1e-12)


def test_observation_adds_the_finite_differences():
    point, h = np.array([[0.3, -0.2, 2.0]]), 1e-6
    J = np.empty((2, 6))
    for k in range(6):
        step = np.eye(6)[k] * h
        J[:, k] = (pixels(SE3.exp(step), point) - pixels(SE3.exp(-step), point))[0] / (2 * h)
    H, g, w = np.ones((6, 6)), np.ones(6), np.array([0.7, -0.4])
    x, y, z = point[0]
    pose.add_observation(K, x / z, y / z, 1 / z, *w, 3.0, H, g)
    upper = np.triu_indices(6)
    assert H[upper] - 1.0 == pytest.approx((3.0 * J.T @ J)[upper], rel=1e-6, abs=1e-2)
    assert g - 1.0 == pytest.approx(J.T @ w, rel=1e-6, abs=1e-3)


def test_factorisation_solves_and_refuses():
    rng = np.random.default_rng(1)
    B = rng.normal(size=(20, 12))
    A, b = B.T @ B, rng.normal(size=12)
    U, x = A.copy(), b.copy()
    assert cholesky.factor_in_place(U)
    cholesky.solve_factored(U, x)
    assert np.allclose(x, np.linalg.solve(A, b), rtol=1e-9)
    assert not cholesky.factor_in_place(-np.eye(3))


def test_rotation_is_made_orthonormal_and_kept():
    R = SE3.exp(np.array([0, 0, 0, 0.4, -1.0, 0.3])).rotation
    spoilt = R + 1e-4 * np.random.default_rng(0).normal(size=(3, 3))
    geometry.orthonormalize(spoilt)
    assert np.allclose(spoilt @ spoilt.T, np.eye(3), atol=1e-15)
    assert np.abs(spoilt - R).max() < 5e-4


@pytest.fixture
def scene():
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-2, 2, 200), rng.uniform(-1.5, 1.5, 200), rng.uniform(3, 7, 200)])
    T = SE3.exp(np.array([0.1, -0.05, 0.2, 0.03, -0.06, 0.02]))
    observed = pixels(T, points) + rng.normal(0, 0.5, (200, 2))
    observed[:50] += rng.uniform(-60, 60, (50, 2))
    return T, points, observed


def optimize(start, points, observed, prior=0.0, sigma_max=0.7):
    every = np.arange(len(points))
    return pose.optimize_pose(
        kernel_camera(PinholeCamera(640, 480, *K)),
        start.rotation,
        start.translation,
        points,
        every,
        observed,
        np.zeros_like(every),
        every >= 0,
        np.full(6, prior),
        4,
        12,
        0.4,
        sigma_max,
    )


def test_a_quarter_of_outliers_does_no_harm(scene):
    T, points, observed = scene
    R, t, weights, information, sigma = optimize(SE3.identity(), points, observed)
    assert np.abs(t - T.translation).max() < 0.003
    assert T.rotation_angle_to(SE3(R, t)) < 0.001
    assert (weights[50:] > 0).mean() > 0.98
    assert (weights[:50] > 0).mean() < 0.15
    assert 0.4 <= sigma < 1.5
    assert np.linalg.eigvalsh(information).min() > 0


def test_matches_from_a_small_circle_can_still_be_wrong(scene):
    """Two in five lie anywhere within 5 px, as a search in a circle leaves them, most of them to one side."""
    T, points, _ = scene
    rng = np.random.default_rng(7)
    observed = pixels(T, points) + rng.normal(0, 0.4, (200, 2))
    observed[:80] += rng.uniform([0.0, -3.5], [5.0, 3.5], (80, 2))
    wrong = np.linalg.norm(observed - pixels(T, points), axis=1) > 3.5
    *_, free, _, sigma = optimize(T, points, observed, sigma_max=10.0)
    R, t, weights, _, shown = optimize(T, points, observed)
    assert shown > 0.7
    assert np.count_nonzero(free[wrong] > 0) > 3 * np.count_nonzero(weights[wrong] > 0)
    assert np.abs(t - T.translation).max() < 0.005
    assert (weights[~wrong] > 0).mean() > 0.85


def test_covariance_matches_the_scatter(scene):
    T, points, _ = scene
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(60):
        observed = pixels(T, points) + rng.normal(0, 0.6, (200, 2))
        R, t, _, information, _ = optimize(T, points, observed)
        errors.append((SE3(R, t) @ T.inverse()).log())
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    assert np.std(errors, axis=0) == pytest.approx(expected, rel=0.5)


def test_a_firm_expectation_holds_the_pose(scene):
    T, points, observed = scene
    R, t, *_ = optimize(SE3.identity(), points, observed, prior=1e12)
    assert np.abs(t).max() < 1e-3
    assert np.abs(R - np.eye(3)).max() < 1e-3
    assert np.abs(T.translation).max() > 0.1
