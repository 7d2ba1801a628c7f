"""Two-view geometry on scenes with known motion."""

import math

import numpy as np
import pytest

from vsx_ros.geometry.epipolar import (
    epipolar_error,
    essential_matrix,
    reprojection_error,
    transfer_error,
    triangulate,
    two_view_motions,
)
from vsx_ros.geometry.se3 import SE3

SIGMA = 1.0 / 525.0


def matches(T_b_a, flat=False, noise=0.4, outliers=0.1, n=300):
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.uniform(-2, 2, n), rng.uniform(-1.5, 1.5, n), rng.uniform(3, 8, n)])
    if flat:
        points[:, 2] = 4.0 + 0.3 * points[:, 0]
    other = T_b_a @ points
    a, b = points[:, :2] / points[:, 2:], other[:, :2] / other[:, 2:]
    b = b + rng.normal(0, noise * SIGMA, b.shape)
    wrong = rng.random(n) < outliers
    b[wrong] = rng.uniform(-0.5, 0.5, (int(wrong.sum()), 2))
    return points, a, b, ~wrong


def direction_error(T, truth):
    cosine = T.translation @ truth.translation / np.linalg.norm(T.translation) / np.linalg.norm(truth.translation)
    return math.degrees(math.acos(min(1.0, cosine)))


@pytest.mark.parametrize(
    "xi", [(0.3, 0.0, 0.02, 0, 0.03, 0), (0.0, 0.02, -0.4, 0.01, 0, 0), (-0.2, 0.1, -0.2, 0, 0.1, 0.02)]
)
def test_motion_in_a_deep_scene(xi):
    truth = SE3.exp(np.array(xi, float))
    _, a, b, _ = matches(truth)
    found = two_view_motions(a, b, SIGMA)
    assert direction_error(found[0], truth) < 4.0
    assert math.degrees(found[0].rotation_angle_to(truth)) < 0.9


def test_flat_scene_is_recognised_and_solved():
    truth = SE3.exp(np.array([0.4, 0.05, 0.1, 0.02, -0.05, 0.01]))
    _, a, b, _ = matches(truth, flat=True)
    found = two_view_motions(a, b, SIGMA)
    assert min(direction_error(T, truth) for T in found[1:]) < 4.0


def test_errors_vanish_for_the_truth_only():
    truth = SE3.exp(np.array([0.4, 0.05, 0.1, 0.02, -0.05, 0.01]))
    _, a, b, _ = matches(truth, noise=0.0, outliers=0.0)
    assert epipolar_error(essential_matrix(truth), a, b).max() < 1e-20
    other = SE3(truth.rotation, np.array([0.0, 0.4, 0.0]))
    assert np.median(epipolar_error(essential_matrix(other), a, b)) > 1e-6
    _, a, b, _ = matches(truth, flat=True, noise=0.0, outliers=0.0)
    normal = np.array([-0.3, 0.0, 1.0]) / 4.0
    H = truth.rotation + np.outer(truth.translation, normal)
    assert transfer_error(H, a, b).max() < 1e-20


def test_triangulation_is_exact_without_noise():
    truth = SE3.exp(np.array([0.3, 0.0, -0.1, 0.02, -0.05, 0.01]))
    points, a, b, _ = matches(truth, noise=0.0, outliers=0.0)
    got, parallax = triangulate(truth, a, b)
    assert got == pytest.approx(points, rel=1e-9, abs=1e-9)
    first = points / np.linalg.norm(points, axis=1)[:, None]
    second = points + truth.rotation.T @ truth.translation
    second /= np.linalg.norm(second, axis=1)[:, None]
    expected = np.linalg.norm(np.cross(first, second), axis=1)
    assert np.sin(parallax) == pytest.approx(expected, rel=1e-6)
    assert reprojection_error(truth, got, b).max() < 1e-12


def test_parallel_rays_and_points_behind_are_visible_to_the_caller():
    truth = SE3(np.eye(3), np.array([0.3, 0.0, 0.0]))
    points, parallax = triangulate(truth, np.array([[0.1, 0.1], [0.0, 0.0]]), np.array([[0.1, 0.1], [-0.1, 0.0]]))
    assert parallax[0] == 0.0
    assert not np.isfinite(points[0]).all() or abs(points[0, 2]) > 1e6
    assert points[1, 2] < 0
    assert np.isinf(reprojection_error(SE3.identity(), points[1:], np.zeros((1, 2)))).all()
