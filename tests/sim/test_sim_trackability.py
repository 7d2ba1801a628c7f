"""Would a tracker believe the pictures? Corners must repeat and optical flow must follow the true motion."""

import cv2
import numpy as np
import pytest
from sim_views import PERFECT, camera_in, standing

from vsx_ros.sim.camera import KINECT, EmulatedCamera
from vsx_ros.sim.renderer import exact_rays
from vsx_ros.sim.scene import Scene
from vsx_ros.sim.world import World

MOTION_M, MOTION_RAD = 0.05, np.radians(1.0)


def flow_errors(camera: EmulatedCamera, x: float, y: float, theta: float) -> tuple[np.ndarray, float]:
    """Errors [px] of Lucas-Kanade against the true flow, and the share of corners found again within 1.5 px."""
    before = np.array([x, y, theta, 0.0])
    after = before + [MOTION_M * np.cos(theta), MOTION_M * np.sin(theta), MOTION_RAD, MOTION_M]
    pictures = [camera.picture(0, standing(*p[:3]), want_depth=True) for p in (before, after)]
    images = [camera._sensor.develop(picture.radiance) for picture in pictures]
    fast = cv2.FastFeatureDetector_create(15)
    a, b = (np.array([k.pt for k in fast.detect(image)], np.float32).reshape(-1, 2) for image in images)
    columns, rows = a.astype(int).T
    depth = pictures[0].depth
    smooth = (cv2.dilate(depth, np.ones((11, 11))) / cv2.erode(depth, np.ones((11, 11))))[rows, columns] < 1.25
    a, z = a[smooth], depth[rows, columns][smooth]
    R, t = camera.poses_cam(np.stack([before, after]))
    points = ((exact_rays(KINECT, a.astype(float)) * z[:, None]) @ R[0].T + t[0] - t[1]) @ R[1]
    truth = KINECT.project(points)
    inside = (np.abs(truth - [319.5, 239.5]) < [305, 225]).all(axis=1) & (z > 1.0)
    a, truth = a[inside], truth[inside]
    again = np.linalg.norm(b[None] - truth[:, None], axis=2).min(axis=1) < 1.5
    guess = truth.astype(np.float32).reshape(-1, 1, 2).copy()
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        images[0], images[1], a.reshape(-1, 1, 2), guess, winSize=(11, 11), maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW, criteria=(3, 50, 1e-3),
    )  # fmt: skip
    return np.linalg.norm(found.reshape(-1, 2) - truth, axis=1)[status.ravel() == 1], float(again.mean())


def test_flow_follows_the_truth_to_a_tenth_of_a_pixel(lab: World, lab_scene: Scene) -> None:
    camera = camera_in(lab_scene, PERFECT)
    errors, repeated = zip(*[flow_errors(camera, lab.start.x, lab.start.y, lab.start.theta_rad + k) for k in (0, 2, 4)])
    error = np.concatenate(errors)
    assert len(error) > 300
    assert np.median(error) < 0.13
    assert np.percentile(error, 90) < 0.5
    assert (error > 1.0).mean() < 0.08
    assert np.mean(repeated) > 0.6


def test_a_slower_motion_does_not_shimmer(lab: World, lab_scene: Scene) -> None:
    """Half a pixel of motion may change grey levels only as interpolation between them would: no aliasing."""
    camera = camera_in(lab_scene, PERFECT)
    x, y, theta = lab.start.x, lab.start.y, lab.start.theta_rad
    images = [camera.picture(0, standing(x, y, theta + k * 0.25 / KINECT.fx)).radiance for k in (0, 1, 2)]
    middle = 0.5 * (images[0] + images[2])
    residual = np.abs(images[1] - middle)[8:-8, 8:-8]
    assert float(residual.mean()) == pytest.approx(0.001, abs=0.001)
