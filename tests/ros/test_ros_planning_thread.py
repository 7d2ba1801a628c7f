"""What a private parameter must be before dynamic_reconfigure's server may see it."""

import math
from typing import Any

import pytest

pytest.importorskip("dynamic_reconfigure")

from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.ros import planning_thread


@pytest.mark.parametrize("stored", ["fast", True, math.nan, [0.1]])
def test_a_speed_that_is_no_number_is_named(stored: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rospy.get_param", lambda *_: stored)
    monkeypatch.setattr("rospy.resolve_name", lambda name: name.replace("~", "/move_base/"))
    config = Config()
    with pytest.raises(ConfigError, match="parameter /move_base/v_m_s is .*; give a number from 0.05 to 0.3"):
        planning_thread.serve_adjustable(config, lambda _: None)


def test_what_can_be_adjusted_is_slower_and_named_as_configured() -> None:
    config = Config()
    numbers = {number.entry: number for number in planning_thread.adjustable_of_plans(config)}
    assert numbers["limits.v_m_s"].high == config.limits.v_m_s
    assert numbers["limits.omega_rad_s"].high == config.limits.omega_rad_s
    assert numbers["planner.phi_rad_m"].low < config.planner.phi_rad_m < numbers["planner.phi_rad_m"].high
    assert all(0.0 < number.low < number.high for number in numbers.values())
