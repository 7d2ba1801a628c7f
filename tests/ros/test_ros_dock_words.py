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
from vsx_ros.runs.process import DONE, FAILED

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


class ToldCommand:
    """A command that hears these statuses: one when it subscribes, some before its question is answered, and one in
    each later moment; after the last, nothing is told any more."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, first: str | None, asked: list[str], later: list[str]) -> None:
        self._asked, self._later = asked, later
        self.moments = 0
        monkeypatch.setattr(dock_command, "subscribe", lambda _topic, _kind, hear, **_: self._begin(hear, first))
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(dock_command.time, "sleep", self._moment)

    def _begin(self, hear: Callable[[String], None], first: str | None) -> None:
        self._hear = hear
        if first is not None:
            self._tell(first)

    def _tell(self, words: str) -> None:
        number, state, reason = words.split(", ")
        self._hear(String(json.dumps({"state": state, "reason": reason, "number": int(number)})))

    def _moment(self, _: float) -> None:
        self.moments += 1
        assert self.moments < 1000, "it waits for a docking that is over"
        if self._later:
            self._tell(self._later.pop(0))

    def ask(self) -> str:
        for words in self._asked:
            self._tell(words)
        return "driving to the dock"

    def pursued(self) -> int:
        return dock_command._pursued(self.ask, DockingState.DOCKED)


def test_a_docking_that_ended_before_the_command_looked_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    told = ToldCommand(monkeypatch, "5, idle, ", ["5, idle, ", "6, creeping, ahead", "6, docked, it charges"], [])
    assert told.pursued() == DONE
    assert told.moments == 0


def test_a_docking_that_ended_before_its_first_status_has_ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lost = "the base does not know where it is in the map"
    assert ToldCommand(monkeypatch, "5, idle, ", [f"6, failed, {lost}"], []).pursued() == FAILED
    assert capsys.readouterr().err.splitlines()[-1] == f"failed: {lost}"
    assert ToldCommand(monkeypatch, f"6, failed, {lost}", [], [f"7, failed, {lost}"]).pursued() == FAILED


def test_an_earlier_docking_and_one_that_goes_on_are_not_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = (
        ["5, failed, no way"] * 3,
        ["6, approaching, driving", "6, searching, looking", "6, docked, it charges"],
    )
    told = ToldCommand(monkeypatch, "5, approaching, driving", before, before + after)
    assert told.pursued() == DONE
    assert told.moments == 6


def test_a_command_that_connects_late_knows_the_docking_before_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    told = ToldCommand(monkeypatch, None, ["5, failed, no way"], ["5, failed, no way", "6, failed, no way"])
    assert told.pursued() == FAILED
    assert told.moments == 2


def test_a_node_that_was_started_anew_or_tells_nothing_any_more_ends_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ToldCommand(monkeypatch, "5, idle, ", ["6, creeping, ahead"], ["900, idle, "]).pursued() == FAILED
    assert capsys.readouterr().err.splitlines()[-1] == "idle: the node dock was started anew"
    for first in (None, "5, idle, "):
        told = ToldCommand(monkeypatch, first, ["6, creeping, ahead"], [])
        with pytest.raises(ConfigError, match=r"nobody has told /dock/status for 10 s; start the robot first"):
            told.pursued()
        assert 90 < told.moments < 110


def test_a_master_that_ends_is_no_end_of_the_docking(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = ToldCommand(monkeypatch, "5, docked, it charges", [], [])
    monkeypatch.setattr(rospy, "is_shutdown", lambda: told.moments > 2)
    assert told.pursued() == FAILED
    assert capsys.readouterr().err.splitlines()[-1] == "not known: the ROS master has ended"
