"""Pinhole camera against OpenCV, and the mount's directions."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from vsx_ros.config import MountConfig
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose, mounted

CAMERA = PinholeCamera(752, 480, 420.5, 420.6, 355.2, 250.3, (-0.2966, 0.0808, 0.001, -0.0005, 0.0))


def test_projection_is_opencvs():
    points = np.random.default_rng(0).uniform([-1, -0.7, 1], [1, 0.7, 4], (60, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), CAMERA.K, np.array(CAMERA.distortion))
    assert np.allclose(CAMERA.project(points), expected.reshape(-1, 2), atol=1e-8)


def test_unprojection_undoes_projection():
    pixels = np.random.default_rng(1).uniform([20, 20], [730, 460], (60, 2))
    assert np.allclose(CAMERA.project(CAMERA.unproject(pixels)), pixels, atol=1e-4)
    ideal = dataclasses.replace(CAMERA, distortion=5 * (0.0,))
    assert np.allclose(ideal.project(ideal.unproject(pixels)), pixels, atol=1e-9)


def test_no_pixels_are_no_points():
    for camera in (CAMERA, dataclasses.replace(CAMERA, distortion=5 * (0.0,))):
        assert camera.unproject(np.empty((0, 2))).shape == (0, 3)


def test_nothing_behind_the_camera_has_a_pixel():
    assert np.isnan(CAMERA.project(np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0]]))).all()


@pytest.mark.parametrize("wrong", [{"fx": math.nan}, {"fy": 0.0}, {"width": 3}, {"fx": -5.0}])
def test_impossible_calibrations_are_refused(wrong):
    good = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(CalibrationError, match="camera"):
        PinholeCamera(**(good | wrong))


def test_mount_looks_ahead_and_down():
    T = mount_pose(0.1, 0.02, 0.3, 0.0)
    assert T @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) == pytest.approx(
        np.array([[1.1, 0.02, 0.3], [0.1, -0.98, 0.3], [0.1, 0.02, -0.7]])
    )
    down = mount_pose(0.0, 0.0, 0.3, 0.2) @ np.array([[0.0, 0.0, 1.0]])
    assert down[0] == pytest.approx([math.cos(0.2), 0.0, 0.3 - math.sin(0.2)])
    left = mount_pose(0.0, 0.0, 0.3, 0.0, 0.2) @ np.array([[0.0, 0.0, 1.0]])
    assert left[0] == pytest.approx([math.cos(0.2), math.sin(0.2), 0.3])
    mount = MountConfig(forward_m=0.1, left_m=0.02, height_m=0.3, pitch_down_rad=0.2, yaw_left_rad=-0.1)
    assert np.array_equal(mounted(mount).matrix(), mount_pose(0.1, 0.02, 0.3, 0.2, -0.1).matrix())
