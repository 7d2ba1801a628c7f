"""Points where the image has no corner: found where the wheels say how the camera stands."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState
from vsx_ros.vision.corners import indexed
from vsx_ros.vision.pyramid import LEVELS


def test_wheels_lead_to_points_that_are_no_corners(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    for frame, odometry, _ in arc_drive.frames[:60]:
        slam.track(frame, odometry)
    front = slam._front
    data = front._preprocessor.take(*arc_drive.frames[60][:2])
    prediction = front._motion.predict(data)
    assert prediction.by_odometry
    bare = data._replace(corners=indexed([np.zeros((0, 2), np.int32)] * LEVELS, data.pyramid))

    def tracked(image, information):
        return front._tracker.track(image, front._here, prediction.T_world_cam, front._local.rows, 0.0, information)

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
