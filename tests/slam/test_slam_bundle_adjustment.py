"""Odometry factors: frames and uncertainties end up in the camera's tangent as they were in the base's. The adjuster:
what it moves, what it removes, what an interruption leaves."""

import math

import numpy as np
import pytest

from vsx_ros.config.maps import OdometryNoiseConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam import bundle_adjustment
from vsx_ros.slam.bundle_adjustment import BundleAdjuster, adjoint, odometry_factor
from vsx_ros.slam.gauge import size_kept
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.loop_correction import scale_is_observed
from vsx_ros.slam.map import Map
from vsx_ros.slam.templates import NewTemplates

MOUNT = mount_pose(-0.09, 0.02, 0.31, 0.1, 0.05)
NOISE = OdometryNoiseConfig()
CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)


def test_adjoint_moves_a_tangent_across():
    T, xi = SE3.exp(np.array([0.3, -0.2, 0.5, 0.4, -0.8, 0.2])), 1e-4 * np.array([1.0, -2.0, 0.5, 0.3, 1.0, -0.7])
    assert (T @ SE3.exp(xi)).matrix() == pytest.approx((SE3.exp(adjoint(T) @ xi) @ T).matrix(), abs=1e-12)


def test_factor_is_the_camera_motion_of_the_base_motion():
    motion = SE2(0.1, 0.02, 0.3)
    factor = odometry_factor(motion, MOUNT, NOISE)
    start = SE3.from_se2(SE2(2.0, 1.0, 0.7)) @ MOUNT
    end = SE3.from_se2(SE2(2.0, 1.0, 0.7) @ motion) @ MOUNT
    assert factor.T_a_b.matrix() == pytest.approx((start.inverse() @ end).matrix(), abs=1e-12)


@pytest.mark.parametrize(
    ("axis", "sigma"),
    [
        (0, NOISE.distance_sigma_m + 0.2 * NOISE.distance_sigma_ratio),
        (1, NOISE.distance_sigma_m + 0.2 * NOISE.sideways_sigma_ratio),
        (5, NOISE.turn_sigma_rad),
    ],
)
def test_one_deviation_of_the_base_costs_one(axis, sigma):
    motion = SE2(0.2, 0.0, 0.0)
    factor = odometry_factor(motion, MOUNT, NOISE)
    off = SE3.from_se2(motion) @ SE3.exp(sigma * np.eye(6)[axis])
    error = (factor.T_a_b.inverse() @ MOUNT.inverse() @ off @ MOUNT).log()
    assert math.sqrt(error @ factor.information @ error) == pytest.approx(1.0, rel=1e-3)


def test_a_heading_that_jumps_by_a_whole_turn_is_as_certain():
    before, now = SE2(0.0, 0.0, 3.1), SE2(-0.1, 0.0, -3.1)  # as messages give them: wrapped
    jumped = before.inverse() @ now
    plain, wrapped = (odometry_factor(motion, MOUNT, NOISE) for motion in (jumped.wrapped(), jumped))
    assert abs(jumped.theta) > 6.0
    assert wrapped.information == pytest.approx(plain.information)


def driven_map(n=8, n_points=80, noise_px=0.3, wheels=True):
    """A straight drive of 0.1 m a keyframe through points, all where they are but for 5 cm; and their true places."""
    rng, world = np.random.default_rng(0), Map()
    truth = rng.uniform([2.0, -1.5, -0.5], [5.0, 1.5, 1.2], (n_points, 3))
    poses = [SE3.from_se2(SE2(0.1 * k, 0.0, 0.0)) @ MOUNT for k in range(n)]
    for k, T in enumerate(poses):
        data = FrameData.without_image(k, SE2(0.1 * k, 0.0, 0.0) if wheels else None)
        world.add_keyframe(data, T if k < 2 else T @ SE3.exp(rng.normal(0, 0.005, 6)), Observations.none())
    templates = NewTemplates(
        np.zeros((n_points, 4)), np.zeros((n_points, 2)), np.zeros((n_points, PATCH, PATCH), np.uint8)
    )
    world.add_points(truth + rng.normal(0, 0.05, truth.shape), templates, 0)
    for k, T in enumerate(poses):
        uv = CAMERA.project(np.array([T.inverse() @ p for p in truth])) + rng.normal(0, noise_px, (n_points, 2))
        world.observe(k, Observations(np.arange(n_points), uv, uv, np.zeros(n_points, np.int64)))
    return world, poses


def adjuster():
    return BundleAdjuster(CAMERA, MOUNT, NOISE)


def offsets(world, poses):
    return [
        float(np.linalg.norm(k.T_world_cam.translation - T.translation))
        for k, T in zip(world.keyframes, poses, strict=True)
    ]


def test_adjusted_keyframes_come_near_the_truth_and_wrong_observations_go():
    world, poses = driven_map()
    observed = world.keyframes[3].observations
    observed.ideal[5] += 40.0
    before = max(offsets(world, poses))
    assert adjuster().adjust(world, list(range(8)), 20)
    assert max(offsets(world, poses)) < 0.004 < before
    assert 5 not in world.keyframes[3].observations.rows
    assert 5 in world.keyframes[4].observations.rows
    assert np.count_nonzero(~world.alive) <= 5


def test_a_point_goes_with_the_observation_it_was_made_of():
    world, _ = driven_map()
    world.keyframes[0].observations.ideal[5] += 40.0
    adjuster().adjust(world, list(range(8)), 20)
    assert not world.alive[5]
    assert all(5 not in keyframe.observations.rows for keyframe in world.keyframes)


def test_a_point_that_runs_away_along_its_rays_goes():
    world, poses = driven_map()
    world.points[5] = far = poses[0] @ np.array([0.0, 0.0, 1e3])
    for keyframe, T in zip(world.keyframes, poses):
        keyframe.observations.ideal[5] = CAMERA.project((T.inverse() @ far)[None])[0]
    adjuster().adjust(world, list(range(8)), 20)
    assert not world.alive[5]
    assert np.count_nonzero(world.alive) > 70


def test_only_the_given_keyframes_move():
    world, _ = driven_map()
    before = [k.T_world_cam.matrix() for k in world.keyframes]
    adjuster().adjust(world, [5, 6], 10)
    moved = [bool((k.T_world_cam.matrix() != T).any()) for k, T in zip(world.keyframes, before)]
    assert moved == [False, False, False, False, False, True, True, False]


def test_without_odometry_a_map_stays_as_large_as_it_was():
    rng = np.random.default_rng(1)
    world, _ = driven_map(wheels=False)
    for k in range(1, 8):
        T = world.keyframes[k].T_world_cam
        world.move_keyframe(k, SE3(T.rotation, T.translation + [0.004 * k, *rng.normal(0.0, 0.002, 2)]))
    before = np.array([k.T_world_cam.translation for k in world.keyframes])
    assert BundleAdjuster(CAMERA, None, NOISE).adjust(world, list(range(8)), 20)
    after = np.array([k.T_world_cam.translation for k in world.keyframes])
    assert after[0] == pytest.approx(before[0], abs=0.0)
    assert np.linalg.norm(after - before, axis=1).max() < 0.03
    assert size_kept(before, after, 0) == pytest.approx(1.0, abs=1e-9)


def test_one_keyframe_that_jumps_does_not_change_the_size_of_the_map():
    before = np.cumsum(np.random.default_rng(2).uniform(0.05, 0.15, (20, 3)), axis=0)
    after = before[3] + 0.8 * (before - before[3])
    assert size_kept(before, after, 3) == pytest.approx(1.25, rel=1e-9)
    after[12] += [1.0, -2.0, 0.5]
    assert size_kept(before, after, 3) == pytest.approx(1.25, rel=2e-3)


def test_culled_keyframes_are_carried_not_adjusted():
    world, _ = driven_map()
    world.cull_keyframe(4)
    anchor = world.keyframes[4].anchor
    assert adjuster().adjust(world, list(range(8)), 10)
    carried = world.keyframes[anchor.keyframe].T_world_cam @ anchor.T_keyframe_this
    assert world.keyframes[4].T_world_cam.matrix() == pytest.approx(carried.matrix(), abs=1e-12)
    assert adjuster().by_odometry(world, 5).T_a_b.matrix() == pytest.approx(
        (world_base(3) @ MOUNT).inverse().matrix() @ (world_base(5) @ MOUNT).matrix(), abs=1e-12
    )


def world_base(k):
    return SE3.from_se2(SE2(0.1 * k, 0.0, 0.0))


def test_no_wheels_between_epochs():
    world, _ = driven_map(4)
    world.odom_segment = 1
    index = world.add_keyframe(FrameData.without_image(9, SE2(7.0, 0.0, 0.0)), SE3.identity(), Observations.none())
    assert adjuster().by_odometry(world, index) is None
    assert adjuster().by_odometry(world, index - 1) is not None


def test_no_wheels_and_no_floor_in_a_map_that_began_without_them():
    world, _ = driven_map(4)
    world.odom_segment = 1
    bases = [None, SE2(7.0, 0.0, 0.0), SE2(7.1, 0.0, 0.0)]
    frames = [FrameData.without_image(9 + k, base) for k, base in enumerate(bases)]
    indices = [world.add_keyframe(data, SE3.identity(), Observations.none(), map_id=1) for data in frames]
    assert (world.is_metric(0), world.is_metric(1)) == (True, False)
    assert adjuster().by_odometry(world, indices[-1]) is None
    assert adjuster()._floor(world, [0, 1, *indices]).frames.tolist() == [0, 1]
    assert not scale_is_observed(world, world.keyframes[indices[-1]])
    world.join(1, into=0)
    assert adjuster().by_odometry(world, indices[-1]) is not None


def test_interrupted_work_is_kept_nothing_is_removed_and_it_goes_on(monkeypatch):
    monkeypatch.setattr(bundle_adjustment, "SLICE_OBSERVATIONS", 1)
    world, poses = driven_map()
    world.keyframes[3].observations.ideal[5] += 40.0
    before, asked = offsets(world, poses), []

    def second_time():
        asked.append(len(asked))
        return len(asked) == 2

    finished = adjuster().adjust(world, list(range(8)), 20, second_time)
    assert not finished
    assert len(asked) == 2
    assert 5 in world.keyframes[3].observations.rows
    assert max(offsets(world, poses)) < max(before)
    assert adjuster().adjust(world, list(range(8)), 20)
    assert 5 not in world.keyframes[3].observations.rows


def test_slices_do_not_change_the_result(monkeypatch):
    whole, _ = driven_map()
    adjuster().adjust(whole, list(range(8)), 20)
    monkeypatch.setattr(bundle_adjustment, "SLICE_OBSERVATIONS", 1)
    sliced, _ = driven_map()
    adjuster().adjust(sliced, list(range(8)), 20)
    for a, b in zip(whole.keyframes, sliced.keyframes, strict=True):
        assert a.T_world_cam.matrix() == pytest.approx(b.T_world_cam.matrix(), abs=1e-9)


def test_nothing_to_adjust_is_no_work():
    world, _ = driven_map(wheels=False)
    assert adjuster().adjust(world, [0], 10)
