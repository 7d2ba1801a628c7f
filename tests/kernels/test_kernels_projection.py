"""Projection against OpenCV, prediction against a slow twin built from PinholeCamera."""

import cv2
import numpy as np
import pytest

from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import project_normalized, unproject_pixels
from vsx_ros.kernels.vision.search import predict

CAMERA = PinholeCamera(640, 480, 525.0, 520.0, 318.0, 243.0, (-0.25, 0.08, 0.001, -0.002, 0.01))


def test_projection_is_opencvs():
    rng = np.random.default_rng(1)
    plane = rng.uniform(-0.5, 0.5, (50, 2))
    expected, _ = cv2.projectPoints(
        np.column_stack([plane, np.ones(50)]), np.zeros(3), np.zeros(3), CAMERA.K, np.array(CAMERA.distortion)
    )
    array = kernel_camera(CAMERA)
    got = np.array([project_normalized(array, x, y) for x, y in plane])
    assert np.allclose(got, expected.reshape(-1, 2), atol=1e-9)


def test_unprojection_undoes_projection():
    rng = np.random.default_rng(2)
    pixels = rng.uniform([0, 0], [639, 479], (80, 2))
    array = kernel_camera(CAMERA)
    plane = unproject_pixels(array, pixels)
    back = np.array([project_normalized(array, x, y) for x, y in plane])
    assert np.abs(back - pixels).max() < 1e-6


@pytest.fixture
def one_template():
    """A point seen straight ahead by a keyframe at the origin, at level 0."""
    basis = np.array([[1 / 525.0, 0.0, 0.0, 1 / 520.0]])
    return {"templates": np.array([[0, -1]]), "source": np.array([0]), "basis": basis}


def predicted(points, T_world_cam, template, camera=CAMERA):
    T = T_world_cam.inverse()
    rows = np.arange(len(points))
    return predict(
        kernel_camera(camera),
        T.rotation,
        T.translation,
        np.asarray(points, float),
        rows,
        np.repeat(template["templates"], len(points), axis=0),
        template["source"],
        template["basis"],
        np.eye(3)[None],
        np.zeros((1, 3)),
        8.0,
    )


def test_prediction_lands_where_the_camera_projects(one_template):
    points = np.array([[0.1, 0.05, 2.0], [-0.6, 0.3, 2.5], [0.0, 0.0, 3.0]])
    pose = SE3.exp(np.array([0.05, 0.0, 0.1, 0.0, 0.05, 0.02]))
    rows, level, uv, _, chosen = predicted(points, pose, one_template)
    assert rows.tolist() == [0, 1, 2]
    assert (level == 0).all()
    assert (chosen == 0).all()
    assert np.allclose(uv, CAMERA.project(pose.inverse() @ points), atol=1e-9)


def test_behind_outside_and_from_the_back_are_invisible(one_template):
    ahead, behind, aside = [0.0, 0.0, 2.0], [0.0, 0.0, -2.0], [3.0, 0.0, 2.0]
    rows, *_ = predicted([behind, ahead, aside], SE3.identity(), one_template)
    assert rows.tolist() == [1]
    turned = SE3(np.diag([-1.0, 1.0, -1.0]), np.array([0.0, 0.0, 4.0]))
    assert predicted([ahead], turned, one_template)[0].tolist() == []


@pytest.mark.parametrize(
    ("distance", "expected"), [(2.0, 0), (1.2, 0), (1.0, 1), (0.6, 1), (0.45, 2), (3.9, 0), (4.2, None)]
)
def test_level_follows_scale(one_template, distance, expected):
    straight = PinholeCamera(640, 480, 525.0, 520.0, 318.0, 243.0)
    pose = SE3(np.eye(3), np.array([0.0, 0.0, 2.0 - distance]))
    rows, level, _, warp, _ = predicted([[0.0, 0.0, 2.0]], pose, one_template, straight)
    assert level.tolist() == ([] if expected is None else [expected])
    if len(rows):
        # One px at the chosen level is 2^level * distance / 2 px of the source.
        assert warp[0] == pytest.approx(
            [2.0**expected * distance / 2.0, 0, 0, 2.0**expected * distance / 2.0], rel=1e-3
        )


def test_nearest_view_among_templates_is_taken():
    basis = np.tile([1 / 525.0, 0.0, 0.0, 1 / 525.0], (2, 1))
    T = SE3(np.eye(3), np.array([0.9, 0.0, 0.0])).inverse()
    *_, chosen = predict(
        kernel_camera(CAMERA),
        T.rotation,
        T.translation,
        np.array([[0.5, 0.0, 2.0]]),
        np.array([0]),
        np.array([[0, 1, -1]]),
        np.array([0, 1]),
        basis,
        np.array([np.eye(3), np.eye(3)]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        8.0,
    )
    assert chosen[0] == 1
