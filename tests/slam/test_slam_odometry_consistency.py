"""Odometry is compared with the image over frames that the image is sure of, near each other in time."""

import math

import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.odometry import OdometryConsistency

FRAME_S, TURN_RAD_S = 0.066, 0.6


@pytest.mark.parametrize("percent", [1, 2, 5])
@pytest.mark.parametrize("is_sure", [False, True])
def test_a_whole_turn_before_a_bare_wall_casts_no_doubt_on_the_wheels(percent: int, is_sure: bool) -> None:
    consistency, true, counted, said = OdometryConsistency(SE3.identity()), SE2(), SE2(), ""
    turn = [(0.0, TURN_RAD_S, is_sure)] * round(2.0 * math.pi / TURN_RAD_S / FRAME_S)
    ahead = [(0.2, 0.0, True)] * 60
    for k, (v, omega, sure) in enumerate([*ahead, *turn, *ahead]):
        true = true @ SE2.exp(v * FRAME_S, omega * FRAME_S)
        counted = counted @ SE2.exp(v * FRAME_S, omega * (1.0 + 0.01 * percent) * FRAME_S)
        consistency.admit(FrameData.without_image(k, counted))
        said += consistency.compare(SE3.from_se2(true)) if sure else ""
    assert said == ""
