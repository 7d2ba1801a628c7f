"""What a viewer is told of the newest frame."""

import numpy as np
import pytest

from vsx_ros.geometry.camera import nominal_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import tracked_features
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked


def test_missed_points_are_where_the_pose_puts_them():
    camera = nominal_camera(640, 480)
    pixels = np.array([[100.0, 120.0], [400.0, 50.0], [320.0, 300.0]])
    pose = SE3.exp(np.array([0.3, -0.2, 0.1, 0.05, 0.1, -0.2]))
    points = pose @ np.vstack([2.0 * camera.unproject(pixels), [[0.0, 0.0, -1.0]]])
    view = Map().view()._replace(points=points)
    found = np.array([1])
    track = Track(
        pose, TrackingState.GOOD, found, pixels[found] + 0.5, np.zeros(1, int), np.arange(4), np.eye(6), ""
    )  # fmt: skip
    seen = tracked_features(camera, view, track)
    assert seen.found == pytest.approx(pixels[[1]] + 0.5)
    assert seen.missed == pytest.approx(pixels[[0, 2]], abs=1e-6)  # the fourth is behind the camera


def test_where_nothing_was_looked_for_nothing_is_seen():
    seen = tracked_features(nominal_camera(640, 480), Map().view(), nothing_tracked("dark"))
    assert seen.found.shape == seen.missed.shape == (0, 2)
