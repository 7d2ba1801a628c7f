"""Light that changes from frame to frame costs no frame and little accuracy."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.slam.slam import SequentialSlam


def breathing(k, image):
    """A gain that swings by a quarter within a second."""
    gain = np.float32(1.0 + 0.25 * math.sin(2.0 * math.pi * k / 15.0))
    return np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)


def mirrored_lamps(k, image):
    """Saturated blobs that stand in the image."""
    spoilt = image.copy()
    for x, y in ((60, 80), (250, 40), (420, 110), (560, 300)):
        spoilt[y : y + 25, x : x + 35] = 255
    return spoilt


def run(drive, change, wheels):
    slam = SequentialSlam(drive.camera, drive.T_base_cam if wheels else None, Config().slam, 1)
    pairs = []
    for k, (frame, odometry, truth) in enumerate(drive.frames):
        result = slam.track(frame._replace(image=change(k, frame.image)), odometry if wheels else None)
        if result.state.tracked:
            pairs.append((result.T_world_cam, truth))
    return slam.statistics(), trajectory_error(pairs, "se3" if wheels else "sim3").ate_rmse_m


@pytest.mark.parametrize("wheels", [True, False])
@pytest.mark.parametrize("change", [breathing, mirrored_lamps])
def test_light_costs_no_frame(arc_drive, change, wheels):
    plain, plain_m = run(arc_drive, lambda k, image: image, wheels)
    lit, lit_m = run(arc_drive, change, wheels)
    assert lit.frames_lost == 0
    assert lit.frames_tracked > plain.frames_tracked - 6
    assert 0.0 < lit_m < max(1.5 * plain_m, 0.008)
    assert lit.u1 > plain.u1 - 0.1
