"""Lens models against OpenCV's, and the laws that hold for each over the whole usable image."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vsx_ros.errors import CalibrationError
from vsx_ros.geometry import lens
from vsx_ros.geometry.camera import PinholeCamera, check_calibration, kernel_camera, usable

KINECT = PinholeCamera(640, 480, 517.3, 516.5, 318.6, 255.3, (0.262383, -0.953104, -0.005358, 0.002628, 1.163314))
WIDE = PinholeCamera(640, 480, 210.2, 211.5, 318.5, 252.5, (0.199416, -0.207364, 0.000704, 0.000806, 0.047875))
BARREL = PinholeCamera(752, 480, 420.5, 420.6, 355.2, 250.3, (-0.2966, 0.0808, 0.001, -0.0005, 0.0))
EIGHT = PinholeCamera(
    1280, 720, 620.0, 618.0, 640.0, 362.0, (4.1, 1.7, 2e-4, -1e-4, 0.07, 4.45, 3.1, 0.42), lens.RATIONAL
)
FISHEYE = PinholeCamera(640, 480, 203.7, 203.5, 321.0, 238.0, (-0.012, 0.006, -0.004, 0.0006), lens.EQUIDISTANT)
CAMERAS = (KINECT, WIDE, BARREL, EIGHT, FISHEYE)


def every_pixel(camera: PinholeCamera, step: int = 7) -> np.ndarray:
    u, v = np.meshgrid(np.arange(0.0, camera.width, step), np.arange(0.0, camera.height, step))
    return np.column_stack([u.ravel(), v.ravel()])


def opencv(camera: PinholeCamera, points: np.ndarray) -> np.ndarray:
    zero, coefficients = np.zeros(3), np.array(camera.distortion)
    if camera.model == lens.EQUIDISTANT:
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.K, coefficients)[0].reshape(-1, 2)
    return cv2.projectPoints(points, zero, zero, camera.K, coefficients)[0].reshape(-1, 2)


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_is_opencvs_and_undone_over_the_usable_image(camera):
    pixels = every_pixel(camera)
    inside = usable(kernel_camera(camera), pixels)
    assert inside.mean() > (0.6 if camera is FISHEYE else 0.999)
    rays = camera.unproject(pixels[inside])
    assert np.abs(camera.project(2.5 * rays) - pixels[inside]).max() < 1e-6
    assert np.abs(opencv(camera, rays) - pixels[inside]).max() < 1e-6


def test_what_is_far_off_the_axis_has_no_pixel():
    angles = np.radians([0.0, 30.0, 60.0, 74.0, 76.0, 89.0, 100.0, 180.0])
    points = np.column_stack([np.sin(angles), np.zeros(8), np.cos(angles)])
    seen = np.isfinite(FISHEYE.project(points)).all(axis=1)
    assert seen.tolist() == [True] * 4 + [False] * 4
    rim = FISHEYE.cx + FISHEYE.fx * lens.radius(FISHEYE.model, FISHEYE.distortion, np.radians([74.0, 76.0]))
    at_rim = usable(kernel_camera(FISHEYE), np.column_stack([rim, [FISHEYE.cy] * 2]))
    assert at_rim.tolist() == [True, False]


@given(st.lists(st.floats(-0.6, 0.6), min_size=4, max_size=4), st.sampled_from(list(lens.COEFFICIENTS)))
@example([-0.279296875, 0.0078125, -0.18359375, -0.16088080318588077], lens.RATIONAL)  # just 60 % of the image
@settings(max_examples=150, deadline=None)
def test_any_coefficients_are_undone_or_refused(ks, model):
    """Radius grows with the angle up to where the lens is said to hold, and round trips stay exact there."""
    k1, k2, k3, k4 = ks
    tangential = 1e-3 * k3, 1e-3 * k4
    distortion = {
        lens.PLUMB_BOB: (k1, k2, *tangential, k3),
        lens.RATIONAL: (k1, k2, *tangential, 0.1 * k3, k4, abs(k2), 0.1 * abs(k3)),
        lens.EQUIDISTANT: (0.2 * k1, 0.1 * k2, 0.05 * k3, 0.02 * k4),
    }[model]
    camera = PinholeCamera(320, 240, 150.0, 150.0, 160.0, 120.0, distortion, model)
    angles = np.linspace(0.0, lens.usable_angle(model, distortion), 500)
    assert (np.diff(lens.radius(model, distortion, angles)) > 0.0).all()
    pixels = every_pixel(camera)
    inside = usable(kernel_camera(camera), pixels)
    assert np.nanmax(np.abs(camera.project(camera.unproject(pixels[inside])) - pixels[inside]), initial=0.0) < 1e-6
    if inside.mean() > 0.6:
        check_calibration(camera, None)
    elif inside.mean() < 0.4:
        with pytest.raises(CalibrationError, match="cannot be undone over most of the image"):
            check_calibration(camera, None)


@pytest.mark.parametrize(
    ("model", "distortion", "expected_deg"),
    [
        (lens.PLUMB_BOB, (0.0,) * 5, 90.0),
        (lens.PLUMB_BOB, (-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0), 45.0),  # r - r^3 / 3 is largest at r = 1
        (lens.RATIONAL, (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0), 45.0),  # r / (1 + r^2), too
        (lens.EQUIDISTANT, (0.0,) * 4, 90.0),
        (lens.EQUIDISTANT, (-1.0 / 3.0, 0.0, 0.0, 0.0), math.degrees(1.0)),
    ],
)
def test_where_the_picture_folds_back(model, distortion, expected_deg):
    assert math.degrees(lens.fold_angle(model, distortion)) == pytest.approx(expected_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"model": "omni"}, "'omni' with 5 coefficients; known are plumb_bob"),
        ({"model": lens.EQUIDISTANT}, "'equidistant' with 5 coefficients"),
        ({"distortion": (0.1,)}, "'plumb_bob' with 1 coefficients"),
    ],
)
def test_a_model_without_its_coefficients_is_refused(wrong, message):
    known = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(CalibrationError, match=message):
        PinholeCamera(**(known | wrong))
    with pytest.raises(CalibrationError, match=r"view of 5\.7.* deg"):
        check_calibration(PinholeCamera(**(known | {"fx": 6400.0, "fy": 6400.0})), None)


def test_the_undistorted_picture_is_black_where_the_lens_does_not_see():
    image = np.full((480, 640), 200, np.uint8)
    flat = cv2.remap(image, *FISHEYE.undistortion(), cv2.INTER_LINEAR)
    assert flat[238, 321] == 200
    narrow = PinholeCamera(640, 480, 100.0, 100.0, 320.0, 240.0, (-0.25, 0.0, 0.0, 0.0, 0.0))
    flat = cv2.remap(image, *narrow.undistortion(), cv2.INTER_LINEAR)
    assert flat[240, 320] == 200
    assert flat[5, 5] == 0
