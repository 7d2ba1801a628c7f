"""The tracker: points that are no corners, poses that are in doubt, wide searches, and what is expected of images."""

import cv2
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.config.maps import TrackerConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.odometry import MotionModel
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.tracker import Tracker
from vsx_ros.vision.corners import indexed
from vsx_ros.vision.pyramid import LEVELS


def on_the_way(drive):
    """The front end after sixty frames, and the image of the next."""
    slam = SequentialSlam(drive.camera, drive.T_base_cam, Config().slam, 1)
    for frame, odometry, _ in drive.frames[:60]:
        slam.track(frame, odometry)
    return slam._front, slam._front._preprocessor.take(*drive.frames[60][:2], metric=True)


def test_wheels_lead_to_points_that_are_no_corners(arc_drive):
    front, data = on_the_way(arc_drive)
    prediction = front._motion.predict(data)
    assert prediction.by_odometry
    bare = data._replace(corners=indexed([np.zeros((0, 2), np.int32)] * LEVELS, data.pyramid))

    def tracked(image, information):
        return front._tracker.track(
            image, front._here, prediction.T_world_cam, front.tracking._local.rows, 0.0, information
        )

    usual, led, alone = (
        tracked(data, prediction.information),
        tracked(bare, prediction.information),
        tracked(bare, None),
    )
    assert usual.state is led.state is TrackingState.GOOD
    assert len(led.rows) > 0.8 * len(usual.rows)
    apart = usual.T_world_cam.inverse() @ led.T_world_cam
    assert np.linalg.norm(apart.translation) == pytest.approx(0.0, abs=0.002)
    assert alone.state is TrackingState.LOST
    assert len(alone.rows) == 0


@pytest.fixture(scope="module")
def sixtieth(arc_drive):
    """(tracker, image, map, pose, rows) of a frame on the way."""
    front, data = on_the_way(arc_drive)
    usual = front._tracker.track(
        data, front._here, front._motion.predict(data).T_world_cam, front.tracking._local.rows, 0.0
    )
    assert usual.state is TrackingState.GOOD
    return front._tracker, data, front._here, usual.T_world_cam, usual.rows


def test_found_points_that_miss_their_places_are_doubted(sixtieth):
    _, data, view, pose, rows = sixtieth
    tracker = Tracker(TrackerConfig(max_residual_px=0.7), np.random.default_rng(0))
    assert tracker.track(data, view, pose, rows, 0.0).state is TrackingState.GOOD
    rng = np.random.default_rng(4)
    depth = (view.points - pose.translation) @ pose.rotation[:, 2]
    bent = view.points + rng.normal(0.0, 1.3 / 525.0, view.points.shape) * np.abs(depth)[:, None]
    track = tracker.track(data, view._replace(points=bent), pose, rows, 0.0)
    assert track.state is TrackingState.DUBIOUS
    assert "miss their places by" in track.reason


def test_points_in_one_corner_leave_the_position_open(sixtieth):
    _, data, view, pose, rows = sixtieth
    tracker = Tracker(TrackerConfig(max_sigma_ratio=0.0015), np.random.default_rng(0))
    assert tracker.track(data, view, pose, rows, 0.0).state is TrackingState.GOOD
    ray = (view.points[rows] - pose.translation) @ pose.rotation
    aside = np.linalg.norm(ray[:, :2] / ray[:, 2:] - np.median(ray[:, :2] / ray[:, 2:], axis=0), axis=1)
    track = tracker.track(data, view, pose, rows[np.argsort(aside)[:40]], 0.0)
    assert track.state is TrackingState.DUBIOUS
    assert "leave the position open" in track.reason


def test_a_few_far_points_do_not_hide_that_the_position_is_open(sixtieth):
    _, data, view, pose, rows = sixtieth
    tracker = Tracker(TrackerConfig(max_sigma_ratio=0.001), np.random.default_rng(0))
    ray = (view.points[rows] - pose.translation) @ pose.rotation
    aside = np.linalg.norm(ray[:, :2] / ray[:, 2:] - np.median(ray[:, :2] / ray[:, 2:], axis=0), axis=1)
    near = rows[np.argsort(aside)[:48]]
    far, points = near[::6], view.points.copy()
    points[far] = pose.translation + 100.0 * (points[far] - pose.translation)
    track = tracker.track(data, view._replace(points=points), pose, near, 0.0)
    assert 0 < np.count_nonzero(np.isin(track.rows, far)) < 0.25 * len(track.rows)
    assert track.state is TrackingState.DUBIOUS
    assert "leave the position open" in track.reason


def test_a_wide_search_does_not_throw_a_good_pose_away(sixtieth):
    tracker, data, view, pose, rows = sixtieth
    wide, near = (tracker.track(data, view, pose, rows, radius) for radius in (60.0, 0.0))
    assert len(wide.rows) > 0.95 * len(near.rows)
    assert np.linalg.norm(wide.T_world_cam.translation - near.T_world_cam.translation) < 0.003


def test_a_pose_beyond_the_fine_circle_is_found_by_the_wide_one(sixtieth):
    tracker, data, view, pose, rows = sixtieth
    off = pose @ SE3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.045, 0.0]))
    wide = tracker.track(data, view, off, rows, 40.0)
    assert wide.state is TrackingState.GOOD
    assert np.linalg.norm(wide.T_world_cam.translation - pose.translation) < 0.003
    assert len(tracker.track(data, view, off, rows, 0.0).rows) < 0.5 * len(wide.rows)


def test_what_the_way_adds_to_the_image_is_expected_again():
    """A camera that glides along a wall: its images move as if it turned, and it does not."""
    texture = cv2.GaussianBlur(np.random.default_rng(1).uniform(-60, 60, (30, 90)).astype(np.float32), (0, 0), 2.0)
    motion, turns = MotionModel(None, (525.0, 525.0)), []
    for k in range(4):
        small = np.ascontiguousarray(texture[:, 2 * k : 2 * k + 40])
        data = FrameData(k * 40_000_000, None, None, small, None, None)
        if k:
            turns.append(motion.predict(data).T_world_cam.rotation_angle_to(SE3.identity()))
        motion.update(data, SE3(np.eye(3), np.array([0.1 * k, 0.0, 0.0])), measured=True)
    assert turns[0] == pytest.approx(2.0 * 16.0 / 525.0, rel=0.1)
    assert max(turns[1:]) < 0.25 * turns[0]
