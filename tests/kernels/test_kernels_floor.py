"""The floor under the frames: derivatives, values in the base's own units, the solver levels, the anchor stays."""

import math

import numpy as np
import pytest
from test_kernels_bundle import Problem

from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam import factors

MOUNT = mount_pose(-0.09, 0.02, 0.31, 0.1, 0.05)


def floor_of(mount, frames=(0,), anchor=-1):
    return factors.Floor(
        np.array(frames), np.array(mount.rotation), mount.inverse().translation, np.array([0.01, 0.02, 0.02]), anchor
    )


def camera_of(T_world_base, mount=MOUNT):
    return (T_world_base @ mount).inverse()


def residual(T, ground):
    return factors.floor_residual(T.rotation, T.translation, ground)


def test_derivatives():
    rng = np.random.default_rng(0)
    ground, h = floor_of(MOUNT), 1e-6
    for _ in range(5):
        T = SE3.exp(rng.normal(0, 0.7, 6))
        J = factors.floor_jacobian(T.rotation, ground)
        for k in range(6):
            step = SE3.exp(h * np.eye(6)[k])
            numeric = (residual(step @ T, ground) - residual(step.inverse() @ T, ground)) / (2 * h)
            assert numeric == pytest.approx(J[:, k], rel=1e-6, abs=1e-6)


def test_zero_wherever_the_base_stands():
    for pose in (SE2(0.0, 0.0, 0.0), SE2(3.0, -2.0, 2.5)):
        assert residual(camera_of(SE3.from_se2(pose)), floor_of(MOUNT)) == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize(("axis", "amount"), [(2, 0.01), (3, 0.02), (4, 0.02)])
def test_one_deviation_of_the_base_counts_one(axis, amount):
    lifted = SE3.from_se2(SE2(1.0, 2.0, 0.7)) @ SE3.exp(amount * np.eye(6)[axis])
    r = residual(camera_of(lifted), floor_of(MOUNT))
    assert np.linalg.norm(r) == pytest.approx(1.0, rel=1e-3)
    assert np.count_nonzero(np.abs(r) > 1e-3) == 1


def test_far_from_the_floor_the_cost_grows_linearly():
    def cost(height):
        T = camera_of(SE3(np.eye(3), np.array([0.0, 0.0, height])))
        return factors.floor_cost(T.rotation[None], T.translation[None], floor_of(MOUNT))

    assert cost(0.01) == pytest.approx(0.5, rel=1e-9)
    assert cost(1.0) - cost(0.9) == pytest.approx(cost(0.9) - cost(0.8), rel=1e-9)


def test_a_leaning_map_is_levelled_without_moving_the_anchor_along_the_floor():
    """The cameras drive level, with y down; the map starts leaning and raised about the first one."""
    problem = Problem(outliers=0.0)
    mount = SE3(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
    world = SE3.exp(np.array([0.0, 0.0, 0.03, 0.02, -0.03, 0.0])) @ mount
    problem.start_poses = [T @ world.inverse() for T in problem.truth]
    problem.start_points = np.array([world @ p for p in problem.points])
    ground = floor_of(mount, range(6), anchor=0)
    R, t, *_ = problem.solve([0, 1, 2, 3, 4, 5], [(k, k + 1) for k in range(5)], iterations=60, ground=ground)
    for f in range(6):
        assert np.abs(residual(problem.start_poses[f], ground)).max() > 0.9
        assert np.abs(residual(SE3(R[f], t[f]), ground)).max() < 0.2
    before = problem.start_poses[0].inverse() @ mount.inverse()
    after = SE3(R[0], t[0]).inverse() @ mount.inverse()
    assert after.translation[:2] == pytest.approx(before.translation[:2], abs=5e-4)
    assert math.atan2(after.rotation[1, 0], after.rotation[0, 0]) == pytest.approx(
        math.atan2(before.rotation[1, 0], before.rotation[0, 0]), abs=2e-3
    )
