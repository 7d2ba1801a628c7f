"""Where what the base meets is put on the map."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy

from vsx_hw.readings import Hazard
from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros.ground_mapping import GroundMapping, touch_pose

T_MAP_ODOM = SE2(1.0, 2.0, math.pi / 2)
WHEELS = Odometry(7, SE2(3.0, 0.5, 0.2), 0.2, 0.0)
"""Perhaps metres after the last pose that the camera found."""


@pytest.mark.parametrize(
    "hazard", [Hazard.BUMPER_LEFT, Hazard.BUMPER_CENTER, Hazard.CLIFF_LEFT, Hazard.CLIFF_CENTER | Hazard.CLIFF_RIGHT]
)
def test_bumpers_and_cliffs_are_where_the_wheels_say(hazard: Hazard) -> None:
    met = touch_pose(hazard, T_MAP_ODOM, WHEELS)
    assert met is not None
    assert met.as_array() == pytest.approx(np.array([0.5, 5.0, math.pi / 2 + 0.2]))


@pytest.mark.parametrize("hazard", [Hazard.NONE, Hazard.WHEEL_DROP_LEFT, Hazard.WHEEL_DROP])
def test_a_raised_wheel_meets_nothing(hazard: Hazard) -> None:
    assert touch_pose(hazard, T_MAP_ODOM, WHEELS) is None


def test_nothing_is_put_on_a_map_in_which_the_base_is_unknown() -> None:
    assert touch_pose(Hazard.BUMPER, None, WHEELS) is None
    assert touch_pose(Hazard.BUMPER, T_MAP_ODOM, None) is None


def test_a_bump_after_the_last_map_is_kept_for_the_next_session(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    ground = GroundMapping(Config())
    ground.started(SE2(0.5, 0.0, 0.0))
    ground.bumped(SE2(1.0, 2.0, 0.0))
    state = ground.state()
    assert state["start"] == pytest.approx([0.5, 0.0, 0.0])
    assert len(state["bumps"]) == 1
    again = GroundMapping(Config())
    again.restore(state)
    assert again.state()["start"] == pytest.approx([0.5, 0.0, 0.0])
    assert len(again.state()["bumps"]) == 1
