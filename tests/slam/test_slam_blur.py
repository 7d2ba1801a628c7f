"""A smeared frame is tracked, named, and leaves no trace in the map."""

import cv2
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

CONFIG = Config().slam
SMEARED = (40, 41, 55, 62, 70, 71, 72, 85, 93, 101, 110)


def smeared(frame, length_px=13):
    return frame._replace(image=cv2.blur(frame.image, (length_px, 1)))


def run(drive, spoilt):
    slam = SequentialSlam(drive.camera, drive.T_base_cam, CONFIG, 1)
    results = []
    for k, (frame, odometry, _) in enumerate(drive.frames):
        results.append(slam.track(smeared(frame) if k in spoilt else frame, odometry))
    return slam, results


def test_smeared_frames_are_tracked_but_make_no_keyframe(arc_drive):
    slam, results = run(arc_drive, SMEARED)
    stamps = set(slam.snapshot().keyframe_stamps_ns.tolist())
    for k in SMEARED:
        assert results[k].state is TrackingState.DUBIOUS
        assert "blurred" in results[k].reason
        assert not results[k].keyframe_added
        assert arc_drive.frames[k][0].stamp_ns not in stamps
    sharp = [r for k, r in enumerate(results) if k not in SMEARED]
    assert sum("blurred" in r.reason for r in sharp) <= 2
    pairs = [(r.T_world_cam, f[2]) for r, f in zip(results, arc_drive.frames) if r.T_world_cam is not None]
    assert trajectory_error(pairs, "se3").ate_rmse_m < 0.01
    assert slam.statistics().frames_lost == 0


def test_a_smeared_frame_does_not_start_the_map(arc_drive):
    _, undisturbed = run(arc_drive, ())
    started = next(k for k, r in enumerate(undisturbed) if r.state is not TrackingState.NOT_INITIALISED)
    _, results = run(arc_drive, (started,))
    assert results[started].state is TrackingState.NOT_INITIALISED
    assert "blurred" in results[started].reason
    later = next(k for k, r in enumerate(results) if r.state is not TrackingState.NOT_INITIALISED)
    assert started < later <= started + 3


@pytest.mark.parametrize("length_px", [9, 21])
def test_the_map_is_as_good_as_without_the_smeared_frames(arc_drive, length_px):
    def accuracy(spoilt):
        slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
        pairs = []
        for k, (frame, odometry, truth) in enumerate(arc_drive.frames):
            result = slam.track(smeared(frame, length_px) if k in spoilt else frame, odometry)
            if result.T_world_cam is not None and k not in spoilt:
                pairs.append((result.T_world_cam, truth))
        return trajectory_error(pairs, "se3").ate_rmse_m

    clean, spoilt = accuracy(()), accuracy(SMEARED)
    assert np.isfinite(spoilt)
    assert spoilt < clean + 0.003
