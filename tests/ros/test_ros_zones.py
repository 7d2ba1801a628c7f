"""Zones and rooms on topics: changes as text, and what other nodes make of them, without a master."""

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

import numpy as np
import rospy
from std_msgs.msg import String
from visualization_msgs.msg import Marker

from vsx_ros.config import Config, RoomsConfig
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.room_file import load_rooms
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.rooms import RoomTracker
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.ros import headers
from vsx_ros.ros.rooms import RoomServer, heard_rooms, room_markers
from vsx_ros.ros.status import StatusBoard, screen
from vsx_ros.ros.zones import ZoneServer, changed, heard_zones, zone_markers
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import snapshot

RUG = Zone("rug", ZoneKind.NO_GO, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))


def test_changes_are_made_and_told_in_words() -> None:
    ground = MappedGround(Config())
    assert changed(ground, json.dumps({"add": RUG.tree()})) == "zone 'rug' is drawn: no-go, 3 corners"
    assert len(ground.zones) == 1
    assert changed(ground, '{"remove": "rug"}') == "zone 'rug' is removed"
    changed(ground, json.dumps({"add": RUG.tree()}))
    assert changed(ground, '{"clear": true}') == "all zones are removed"
    assert len(ground.zones) == 0
    assert ground.zones.version == 4


@pytest.mark.parametrize("text", ["", "3", "{}", '{"add": 3}', '{"move": 1}', '{"remove": "x"}', '{"add": {}, "a": 1}'])
def test_no_change_is_refused_in_words(text: str) -> None:
    with pytest.raises(InputError):
        changed(MappedGround(Config()), text)


def test_what_is_told_is_heard() -> None:
    told = String(json.dumps({"version": 3, "frame": "map", "zones": [RUG.tree()]}))
    assert heard_zones(told) == ([RUG], 3)
    for text in ("", "[]", '{"version": 1}', '{"version": 1, "zones": 3}', '{"version": "a", "zones": []}'):
        with pytest.raises(InputError):
            heard_zones(String(text))


def test_markers_draw_closed_borders_and_open_walls() -> None:
    wall = RUG._replace(name="wall", kind=ZoneKind.WALL)
    markers = zone_markers([RUG, wall], 10**9).markers
    assert markers[0].action == Marker.DELETEALL
    assert [len(marker.points) for marker in markers if marker.ns == "zones"] == [4, 3]
    assert [marker.text for marker in markers if marker.text] == ["rug", "wall"]


class Heard:
    """Stands for every publisher. told: what was published, by topic."""

    told: dict[str, list[Any]]

    def __init__(self, topic: str, *_: object, **__: object) -> None:
        self._topic = topic

    def publish(self, what: Any) -> None:
        self.told.setdefault(self._topic, []).append(what)


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Nodes without a master."""
    Heard.told = {}
    monkeypatch.setattr(rospy, "Publisher", Heard)
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    monkeypatch.setattr(headers, "now_ns", lambda: 10**9)
    return Heard.told


def two_rooms() -> OccupancyGrid:
    data = np.full((80, 160), OCCUPIED, np.int8)
    data[1:-1, 1:79] = data[1:-1, 81:-1] = FREE
    data[30:48, 79:81] = FREE
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


def on_screen(told: dict[str, list[Any]]) -> dict[str, str]:
    """The lines of ``vsx status`` after what was told last."""
    board = object.__new__(StatusBoard)
    board._facts = dict.fromkeys(
        ("state", "reason", "slam_state", "slam_reason", "tracked_ratio", "camera_hz", "driver", "base_reason",
         "estop", "held_by", "held_since_ns", "hazards", "battery_fraction", "battery_v", "charging", "left_s",
         "battery_left_s", "docking", "docking_reason")
    )  # fmt: skip
    board._facts["left_s"] = 230
    board._on_zones(String(told["zones"][-1]))
    board._on_rooms(String(told["rooms"][-1]))
    return dict(line.split(None, 1) for line in screen(board._facts).splitlines())


def test_who_enters_a_zone_is_warned_once_and_status_says_where_the_robot_is(
    told: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    warned: list[str] = []
    monkeypatch.setattr(rospy, "logwarn", lambda form, *words: warned.append(form % words))
    ground, base, nothing = MappedGround(Config()), [SE2(-1.0, 0.5, 0.0)], snapshot(Map().view())
    zones = ZoneServer(ground, lambda: nothing, lambda: base[-1], Config())
    rooms = RoomServer(Config(), kept=tmp_path / "map.yaml")
    ground.zones.add(RUG)
    for x in (-1.0, -0.3, -0.1, 0.2, 0.3, 1.5, 0.5, 6.0):
        base.append(SE2(x, 0.2, 0.0))
        zones.publish(nothing)
        rooms.update(two_rooms(), base[-1])
        if x == 0.3:
            lines = on_screen(told)
            assert lines["zones"] == "THE ROBOT REACHES INTO 'rug'; rug (no-go)"
            assert lines["exploration"] == "-; about 4 minutes left"
            assert lines["room"] == "room 1 (number 1), 100% known; 2 in the map"
    assert warned == ["the robot reaches into the zone 'rug'"] * 2
    lines = on_screen(told)
    assert lines["zones"] == "rug (no-go)"
    assert lines["room"].startswith("room 2 (number 2)")
    assert [heard_zones(String(text))[0] for text in told["zones"]][-1] == [RUG]
    rooms._name('{"room": 2, "name": "bath"}')
    assert heard_rooms(String(told["rooms"][-1]))[0][1].name == "bath"
    kept = load_rooms(tmp_path / "map_rooms.json")
    assert kept is not None
    assert kept.named("bath") is not None


def test_rooms_are_drawn_with_outline_and_name_and_nonsense_is_refused() -> None:
    rooms = RoomTracker(RoomsConfig()).update(two_rooms()).rooms
    markers = room_markers(rooms, 10**9).markers
    borders = [marker for marker in markers if marker.ns == "rooms"]
    assert [len(border.points) for border in borders] == [len(room.outline) + 1 for room in rooms]
    assert [(m.text, m.pose.position.x) for m in markers if m.text] == [(room.name, room.place[0]) for room in rooms]
    for text in ("", "[]", "{}", '{"rooms": 3}', '{"rooms": [{"number": 1}]}', '{"rooms": [], "here": "kitchen"}'):
        with pytest.raises(InputError):
            heard_rooms(String(text))
