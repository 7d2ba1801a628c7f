"""Where odometry and image contradict each other: which of the two poses is taken."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.frame_tracker import MAX_STEP_M, PULLED_PX, FrameTracker
from vsx_ros.slam.odometry import Prediction
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked

HERE = SE3.identity()


def ahead(metres: float) -> SE3:
    return SE3(np.eye(3), np.array([0.0, 0.0, metres]))


def found(pose: SE3, count: int, sigma_px: float) -> Track:
    """Of 300 points searched; all found ones are settled."""
    return nothing_tracked("", pose)._replace(
        state=TrackingState.GOOD, rows=np.arange(count), searched_rows=np.arange(300),
        settled=np.ones(count, np.bool_), sigma_px=sigma_px,
    )  # fmt: skip


def taken(by_odometry: Track, by_image: Track) -> Track:
    """The track of a frame whose searches end in these, the second without odometry. Both predict the pose HERE."""
    tracks, data = iter([by_odometry, by_image]), SimpleNamespace(blurred=False)
    data._replace = lambda **_: data
    tracker: Any = SimpleNamespace(track=lambda *_: next(tracks))
    motion: Any = SimpleNamespace(last_pose=HERE, predict=lambda _: Prediction(HERE, False, np.zeros(6)))
    frames, local = FrameTracker(Config().slam, tracker, motion), SimpleNamespace(view=None, rows=np.arange(300))
    frames.coarse_next = False
    frame: Any = data
    part: Any = local
    return frames._checked_track(frame, part, Prediction(HERE, True, np.ones(6)), tracked_before=True)


@pytest.mark.parametrize("leap_m", [MAX_STEP_M + 0.01, 0.25])
def test_no_pose_far_from_the_motion_before_replaces_one_by_odometry(leap_m: float) -> None:
    doubted = found(HERE, 142, PULLED_PX + 0.2)
    assert taken(doubted, found(ahead(leap_m), 200, 1.0)) is doubted


def test_of_two_plausible_poses_the_one_with_more_settled_points_is_taken() -> None:
    doubted, better = found(HERE, 142, PULLED_PX + 0.2), found(ahead(0.05), 200, 1.0)
    assert taken(doubted, better) is better
    worse = found(ahead(0.05), 100, 1.0)
    assert taken(doubted, worse) is doubted


def test_where_odometry_leaps_the_image_leads_and_where_both_do_nothing_is_found() -> None:
    odometry_leaps, smooth = found(ahead(0.5), 142, 1.0), found(ahead(0.02), 120, 1.0)
    assert taken(odometry_leaps, smooth) is smooth
    both = taken(odometry_leaps, found(ahead(0.3), 120, 1.0))
    assert both.state is TrackingState.LOST
    assert both.reason.startswith("contradicts odometry by 0.50 m")
