"""Ray search on a rendered plane of known depth, with lens distortion."""

import cv2
import numpy as np
import pytest

from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.epipolar import triangulate
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.kernels.slam.epipolar import search_rays
from vsx_ros.vision.corners import CornerDetector, strongest
from vsx_ros.vision.patch_search import cast_rays, cut_patches, target_of
from vsx_ros.vision.pyramid import build_pyramid

CAMERA = PinholeCamera(320, 240, 260.0, 260.0, 160.0, 120.0, (-0.2, 0.05, 0.0, 0.0, 0.0))
DEPTH = 2.0


def view(T_world_cam):
    """The plane z = 2 m with a random texture, ray-cast exactly."""
    rng = np.random.default_rng(11)
    coarse = rng.uniform(20, 235, (200, 200)).astype(np.float32)
    texture = cv2.resize(coarse, (1600, 1600), interpolation=cv2.INTER_CUBIC)
    v, u = np.mgrid[0:240, 0:320]
    rays = CAMERA.unproject(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ T_world_cam.rotation.T
    hit = T_world_cam.translation + rays * ((DEPTH - T_world_cam.translation[2]) / rays[:, 2])[:, None]
    at = (hit[:, :2] * 250 + 800).astype(np.float32).reshape(240, 320, 2)
    image = cv2.remap(texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    return build_pyramid(np.clip(image, 0, 255).astype(np.uint8))


@pytest.mark.parametrize(
    "motion",
    [(0.0, 0.02, 0.35), *(pytest.param(t, marks=pytest.mark.compiled) for t in ((0.15, 0.0, 0.0), (-0.1, 0.05, -0.2)))],
)
def test_corners_are_found_along_their_rays(motion):
    T = SE3.exp(np.array([*motion, 0.02, -0.03, 0.05]))
    source, target = view(SE3.identity()), view(T)
    corners = strongest(source.level(0), np.zeros((240, 320), np.bool_), 120)
    array = kernel_camera(CAMERA)
    rays, basis = cast_rays(array, corners, 0)
    detected = CornerDetector().detect(target)
    to_target = T.inverse()
    found, uv, _ = search_rays(
        array,
        to_target.rotation,
        to_target.translation,
        rays,
        basis,
        cut_patches(source, corners, 0),
        np.tile([1 / 8.0, 1 / 0.8], (len(corners), 1)),
        target_of(target, detected),
    )
    true = CAMERA.project(to_target @ (np.column_stack([rays, np.ones(len(corners))]) * DEPTH))
    inside = ((true > 12) & (true < [307, 227])).all(axis=1)
    assert found[inside].mean() > 0.6
    error = np.linalg.norm(uv - true, axis=1)[found & inside]
    assert np.median(error) < 0.12
    assert (error < 1.0).mean() > 0.97
    points, parallax = triangulate(to_target, rays[found], unproject_pixels(array, uv[found]))
    assert np.median(points[parallax > 0.02, 2]) == pytest.approx(DEPTH, rel=0.01)


def test_a_depth_range_without_the_truth_finds_little():
    T = SE3(np.eye(3), np.array([0.15, 0.0, 0.0]))
    source, target = view(SE3.identity()), view(T)
    corners = strongest(source.level(0), np.zeros((240, 320), np.bool_), 120)
    array = kernel_camera(CAMERA)
    rays, basis = cast_rays(array, corners, 0)
    detected = CornerDetector().detect(target)
    found, *_ = search_rays(
        array,
        np.eye(3),
        -T.translation,
        rays,
        basis,
        cut_patches(source, corners, 0),
        np.tile([1 / 1.0, 1 / 0.5], (len(corners), 1)),
        target_of(target, detected),
    )
    assert found.mean() < 0.15
