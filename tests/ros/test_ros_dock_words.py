"""What the node dock takes and tells, without a master."""

import json
import math
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout, String, UInt8MultiArray

from vsx_hw.readings import DockBeam, DockSignals
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DockSight
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.ros import dock_command, energy_messages
from vsx_ros.ros.docking import heard_sight, wanted_dock
from vsx_ros.ros.emulated_base import before_dock, dock_pose
from vsx_ros.ros.status import StatusBoard, screen
from vsx_ros.runs.process import DONE

UNKNOWN = dict.fromkeys(
    ("state", "reason", "slam_state", "slam_reason", "tracked_ratio", "camera_hz", "driver", "base_reason", "estop",
     "held_by", "held_since_ns", "hazards", "battery_fraction", "battery_v", "charging", "battery_left_s", "docking",
     "docking_reason", "zones", "zones_entered", "room", "left_s")
)  # fmt: skip


def test_a_request_names_a_place_or_none() -> None:
    assert wanted_dock("") is None
    assert wanted_dock("{}") is None
    assert wanted_dock('{"at": [1, -2.5, 3.0]}') == SE2(1.0, -2.5, 3.0)


@pytest.mark.parametrize(
    "text",
    [
        "no",
        "[]",
        '{"to": [1, 2, 3]}',
        '{"at": [1, 2]}',
        '{"at": [1, 2, "3"]}',
        '{"at": [1, 2, true]}',
        '{"at": [1e9, 0, 0]}',
    ],
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        wanted_dock(text)


def test_the_sight_comes_back_from_its_message() -> None:
    msg = energy_messages.dock_ir(DockSignals("create2", DockBeam.RIGHT, DockBeam.HALO | DockBeam.LEFT, DockBeam.NONE))
    assert heard_sight(msg) == ("create2", DockSight(right=32, centre=80, left=0))


def test_a_sight_of_another_shape_is_refused() -> None:
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label="kobuki", size=3)])
    for msg in (UInt8MultiArray(layout, b"12"), UInt8MultiArray(MultiArrayLayout(), b"123")):
        with pytest.raises(InputError, match="three receivers"):
            heard_sight(msg)


def test_the_dock_of_the_emulator_is_a_pose_or_absent() -> None:
    assert dock_pose("") is None
    there = dock_pose("1,-2,180")
    assert there is not None
    assert (there.x, there.y, there.theta) == pytest.approx((1.0, -2.0, 3.14159), abs=1e-4)
    with pytest.raises(ConfigError, match="X,Y,DEG"):
        dock_pose("1,2")


def test_the_status_says_how_long_the_battery_lasts_and_what_the_docking_does() -> None:
    facts = UNKNOWN | {"battery_fraction": 0.5, "battery_v": 15.0, "charging": False, "battery_left_s": 4500}
    lines = screen(facts).splitlines()
    assert "battery      50%, 15.0 V, lasts about 1 h 15 min" in lines
    assert not any(line.startswith("dock ") for line in lines)
    facts |= {"battery_left_s": None, "charging": True, "docking": "docked", "docking_reason": "on the dock"}
    lines = screen(facts).splitlines()
    assert "battery      50%, 15.0 V, charging" in lines
    assert "dock         docked: on the dock" in lines
    assert StatusBoard.__doc__ is not None
    assert "dock/status" in StatusBoard.__doc__


def test_the_wall_at_a_dock_does_not_shade_it_and_the_others_may_reflect() -> None:
    walls = np.array([[4.0, -1.0, 4.0, 1.0], [3.98, 3.0, 2.0, 3.0], [-9.0, 0.0, -9.0, 1.0]])
    at = before_dock(SE2(4.02, 0.0, math.pi), SE2(3.0, 0.1, 0.0), walls)
    assert np.allclose(at.walls, [(0.04, -3.0, 2.02, -3.0)])
    assert (at.x_m, at.y_m) == pytest.approx((1.02, -0.1))
    assert at.heading_rad == pytest.approx(-math.pi)


def test_a_docking_that_ended_before_the_command_looked_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    tell: list[Callable[[String], None]] = []

    def ask() -> str:
        for state in ("idle", "creeping", "docked"):
            tell[0](String(json.dumps({"state": state, "reason": ""})))
        return "driving to the dock"

    def waits_for_ever(_: float) -> None:
        pytest.fail("it waits for a docking that is over")

    monkeypatch.setattr(dock_command, "subscribe", lambda _topic, _kind, callback, **_: tell.append(callback))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(dock_command.time, "sleep", waits_for_ever)
    assert dock_command._pursued(ask, DockingState.DOCKED) == DONE
