"""Odometry factors: frames and uncertainties end up in the camera's tangent as they were in the base's."""

import math

import numpy as np
import pytest

from vsx_ros.config import WheelConfig
from vsx_ros.geometry.camera import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.bundle_adjustment import adjoint, odometry_factor

MOUNT = mount_pose(-0.09, 0.02, 0.31, 0.1, 0.05)
WHEELS = WheelConfig()


def test_adjoint_moves_a_tangent_across():
    T, xi = SE3.exp(np.array([0.3, -0.2, 0.5, 0.4, -0.8, 0.2])), 1e-4 * np.array([1.0, -2.0, 0.5, 0.3, 1.0, -0.7])
    assert (T @ SE3.exp(xi)).matrix() == pytest.approx((SE3.exp(adjoint(T) @ xi) @ T).matrix(), abs=1e-12)


def test_factor_is_the_camera_motion_of_the_base_motion():
    motion = SE2(0.1, 0.02, 0.3)
    factor = odometry_factor(motion, MOUNT, WHEELS)
    start = SE3.from_se2(SE2(2.0, 1.0, 0.7)) @ MOUNT
    end = SE3.from_se2(SE2(2.0, 1.0, 0.7) @ motion) @ MOUNT
    assert factor.T_a_b.matrix() == pytest.approx((start.inverse() @ end).matrix(), abs=1e-12)


@pytest.mark.parametrize(
    ("axis", "sigma"),
    [
        (0, WHEELS.distance_sigma_m + 0.2 * WHEELS.distance_sigma_ratio),
        (1, WHEELS.distance_sigma_m + 0.2 * WHEELS.sideways_sigma_ratio),
        (5, WHEELS.turn_sigma_rad),
    ],
)
def test_one_deviation_of_the_base_costs_one(axis, sigma):
    motion = SE2(0.2, 0.0, 0.0)
    factor = odometry_factor(motion, MOUNT, WHEELS)
    off = SE3.from_se2(motion) @ SE3.exp(sigma * np.eye(6)[axis])
    error = (factor.T_a_b.inverse() @ MOUNT.inverse() @ off @ MOUNT).log()
    assert math.sqrt(error @ factor.information @ error) == pytest.approx(1.0, rel=1e-3)
