"""Rolling shutter: rows seen from where the camera was at their own time are brought to one."""

from dataclasses import replace

import numpy as np
import pytest

from vsx_ros.config.maps import ShutterConfig
from vsx_ros.geometry.camera import PinholeCamera, Shutter, kernel_camera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import ideal_pixels, project_normalized, unproject_pixels
from vsx_ros.robot import Odometry
from vsx_ros.slam.preprocessing import RollingShutter

CAMERA = PinholeCamera(640, 480, 517.3, 516.5, 318.6, 255.3, (0.262383, -0.953104, -0.005358, 0.002628, 1.163314))
MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.1, 0.0)
ODOMETRY = Odometry(1_000_000_000, SE2(1.0, 2.0, 0.5), 0.3, 0.6)
READOUT_S, EXPOSURE_S = 0.026, 0.015


@pytest.fixture
def exposure():
    return RollingShutter(CAMERA, MOUNT, ShutterConfig(readout_s=READOUT_S, exposure_s=EXPOSURE_S)).exposure(ODOMETRY)


def camera_after(seconds):
    T_odom_base = ODOMETRY.T_odom_base @ SE2.exp(ODOMETRY.v * seconds, ODOMETRY.omega * seconds)
    return SE3.from_se2(T_odom_base) @ MOUNT


def seen_row_by_row(points):
    """(N, 2) pixels of points (N, 3) in the camera at the middle row's time: each from where its row was exposed."""
    middle_s = 0.5 * (READOUT_S + EXPOSURE_S)
    pixels = CAMERA.project(points)
    for _ in range(20):
        for k, (_, v) in enumerate(pixels.copy()):
            at_row = camera_after(middle_s + READOUT_S * ((v + 0.5) / CAMERA.height - 0.5))
            pixels[k] = CAMERA.project(at_row.inverse() @ camera_after(middle_s) @ points[k : k + 1])[0]
    return pixels


def grid_of_points(depth):
    u, v = np.meshgrid(np.linspace(20, 620, 9), np.linspace(15, 465, 9))
    rays = CAMERA.unproject(np.column_stack([u.ravel(), v.ravel()]))
    return np.column_stack([rays[:, :2], np.ones(len(rays))]) * depth


def test_a_moving_camera_sees_what_its_middle_row_would_have_seen(exposure):
    camera, _ = exposure
    points = grid_of_points(2.5)
    seen = seen_row_by_row(points)
    still = CAMERA.project(points)
    assert 3.0 < np.abs(seen - still).max() < 8.0
    got = ideal_pixels(camera, seen, points[:, 2])
    ideal = points[:, :2] / points[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
    assert np.abs(got - ideal).max() < 0.08


def test_projection_undoes_unprojection(exposure):
    camera, _ = exposure
    pixels = np.array([[10.0, 5.0], [630.0, 470.0], [320.0, 240.0], [600.0, 20.0]])
    plane = unproject_pixels(camera, pixels)
    back = np.array([project_normalized(camera, x, y) for x, y in plane])
    assert np.abs(back - pixels).max() < 0.5
    assert np.abs(plane - unproject_pixels(kernel_camera(CAMERA), pixels)).max() > 3e-3


def test_the_pose_of_the_middle_tells_that_of_the_stamp(exposure):
    _, T_middle_stamp = exposure
    middle = camera_after(0.5 * (READOUT_S + EXPOSURE_S))
    assert (middle @ T_middle_stamp).matrix() == pytest.approx(camera_after(0.0).matrix(), abs=1e-12)


def test_nothing_is_bent_without_wheels_or_with_a_global_shutter():
    pixels = np.array([[10.0, 5.0], [630.0, 470.0]])
    still = unproject_pixels(kernel_camera(CAMERA), pixels)
    without = RollingShutter(CAMERA, MOUNT, ShutterConfig()).exposure(None)
    at_once = RollingShutter(CAMERA, MOUNT, ShutterConfig(readout_s=0.0, exposure_s=0.0)).exposure(ODOMETRY)
    unknown = RollingShutter(CAMERA, MOUNT, ShutterConfig()).exposure(ODOMETRY)
    for camera, _ in (without, at_once, unknown):
        assert (unproject_pixels(camera, pixels) == still).all()


def test_the_shutter_is_the_cameras_unless_the_configuration_says_other(exposure):
    own = replace(CAMERA, shutter=Shutter(READOUT_S, EXPOSURE_S))
    assert RollingShutter(own, MOUNT, ShutterConfig()).exposure(ODOMETRY)[0] == pytest.approx(exposure[0])
    quicker = RollingShutter(own, MOUNT, ShutterConfig(readout_s=0.01))
    assert quicker.middle_ns == round(0.5e9 * (0.01 + EXPOSURE_S))
