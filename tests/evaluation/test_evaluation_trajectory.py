import math

import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.evaluation.trajectory import align, associate, path_length, trajectory_error
from vsx_ros.geometry.se3 import SE3, StampedPose, so3_exp


@pytest.fixture
def walk():
    """A random smooth walk of 60 poses, about 6 m long."""
    rng = np.random.default_rng(7)
    poses = [SE3.identity()]
    for _ in range(59):
        poses.append(poses[-1] @ SE3.exp(np.array([0.1, 0, 0, *rng.normal(0, 0.1, 3)])))
    return [StampedPose(i * 10**8, T) for i, T in enumerate(poses)]


def moved(walk, T, scale=1.0):
    return [StampedPose(p.stamp_ns, SE3(T.rotation @ p.T.rotation, scale * (T @ p.T).translation)) for p in walk]


@pytest.mark.parametrize("kind", ["se3", "sim3"])
def test_any_rigid_motion_is_aligned_away(walk, kind):
    T = SE3.exp(np.array([3.0, -2, 1, 0.5, 2.0, -1.0]))
    error = trajectory_error(associate(moved(walk, T), walk), kind)
    assert error.ate_rmse_m < 1e-9
    assert error.rpe_rmse_m < 1e-9
    assert error.rpe_rmse_deg < 1e-5
    assert error.scale_error < 1e-9


def test_only_sim3_forgives_scale(walk):
    shrunk = moved(walk, SE3.identity(), 0.9)
    strict, lenient = (trajectory_error(associate(shrunk, walk), kind) for kind in ("se3", "sim3"))
    assert lenient.ate_rmse_m < 1e-9
    assert strict.ate_rmse_m > 0.02
    assert strict.scale == pytest.approx(1 / 0.9)
    assert strict.scale_error == pytest.approx(0.1)


def test_yaw_alignment_forgives_heading_but_not_tilt(walk):
    turned = moved(walk, SE3(so3_exp(np.array([0, 0, 1.2])), np.array([1.0, 2, 3])))
    tilted = moved(walk, SE3(so3_exp(np.array([0.2, 0, 0])), np.zeros(3)))
    assert trajectory_error(associate(turned, walk), "yaw").ate_rmse_m < 1e-9
    assert trajectory_error(associate(tilted, walk), "yaw").ate_rmse_m > 0.02
    assert trajectory_error(associate(tilted, walk), "se3").ate_rmse_m < 1e-9


def test_known_noise_gives_a_known_error(walk):
    rng = np.random.default_rng(0)
    noisy = [StampedPose(p.stamp_ns, SE3(p.T.rotation, p.T.translation + rng.normal(0, 0.02, 3))) for p in walk]
    error = trajectory_error(associate(noisy, walk))
    assert 0.8 < error.ate_rmse_m / (0.02 * math.sqrt(3)) < 1.2
    assert 0.8 < error.rpe_rmse_m / (0.02 * math.sqrt(6)) < 1.2


def test_alignment_is_the_least_squares_one(walk):
    rng = np.random.default_rng(1)
    truth = np.array([p.T.translation for p in walk])
    estimate = truth + rng.normal(0, 0.1, truth.shape)
    for kind in ("se3", "sim3", "yaw"):
        best = align(estimate, truth, kind)
        least = np.sum((best.apply(estimate) - truth) ** 2)
        for _ in range(30):
            axis = np.array([0, 0, rng.normal(0, 0.02)]) if kind == "yaw" else rng.normal(0, 0.02, 3)
            scale = best.scale * (math.exp(rng.normal(0, 0.02)) if kind == "sim3" else 1.0)
            R = so3_exp(axis) @ best.rotation
            other = scale * estimate @ R.T + best.translation + rng.normal(0, 0.02, 3)
            assert np.sum((other - truth) ** 2) >= least


def test_a_mirror_image_is_not_aligned_by_reflection(walk):
    truth = np.array([p.T.translation for p in walk])
    assert np.linalg.det(align(truth * [1, 1, -1], truth, "sim3").rotation) == pytest.approx(1.0)


def test_association_takes_the_nearest_once(walk):
    late = [StampedPose(p.stamp_ns + 5_000_000, p.T) for p in walk]
    doubled = sorted(late + [StampedPose(p.stamp_ns + 1_000_000, p.T) for p in walk], key=lambda p: p.stamp_ns)
    assert len(associate(late, walk[::2])) == 30
    assert len(associate(doubled, walk)) == 60
    assert len(associate(walk, walk[::-1])) == 60


def test_clocks_that_do_not_meet_are_refused(walk):
    shifted = [StampedPose(p.stamp_ns + 10**12, p.T) for p in walk]
    with pytest.raises(InputError, match="only 0 of 60.*same clock"):
        associate(shifted, walk)


def test_too_few_poses_are_no_matter_of_clocks(walk):
    with pytest.raises(InputError, match="only 2 of 2 .* at least 3 are needed$"):
        associate(walk[:2], walk)


def test_standing_still_has_no_scale_error(walk):
    still = [StampedPose(p.stamp_ns, SE3.identity()) for p in walk]
    assert trajectory_error(associate(still, still)).scale_error is None


def test_an_estimate_that_never_moves_is_all_wrong_in_scale(walk):
    still = [StampedPose(p.stamp_ns, SE3.identity()) for p in walk]
    for kind in ("se3", "sim3", "yaw"):
        error = trajectory_error(associate(still, walk), kind)
        assert (error.scale, error.scale_error) == (None, 1.0)
        assert error.ate_rmse_m > 0.1


def test_path_length_of_a_square():
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 0]], float)
    assert path_length([StampedPose(i, SE3(np.eye(3), c)) for i, c in enumerate(corners)]) == pytest.approx(8.0)
    assert path_length([]) == 0.0
