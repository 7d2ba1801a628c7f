"""A Kobuki moves 200 ms after its command (firmware 1.2.0): following stays stable."""

import math

import following
import numpy as np
import pytest
from following import drive

from vsx_ros.config import LimitsConfig
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path
from vsx_ros.planning.time_scaling import time_scale


@pytest.mark.parametrize("goal", [(2.0, 0.0, 0.0), (1.5, 0.8, 0.7), (1.2, -1.0, -1.0)])
def test_a_dead_time_of_200_ms_overshoots_by_less_than_five_percent(monkeypatch, goal):
    monkeypatch.setattr(following, "COMMAND_DELAY_S", 0.2)
    path = connect(SE2(), SE2(*goal), 1.0)
    assert isinstance(path, Path)
    driven = drive(time_scale(path, LimitsConfig()), 1, wheel_error=0.0)
    assert driven.status is FollowStatus.ARRIVED
    assert driven.final_m < 0.05 * math.hypot(goal[0], goal[1])
    assert np.abs(driven.lateral_m).max() < 0.05 * math.hypot(goal[0], goal[1])
