"""Zones and rooms on topics: changes as text, and what other nodes make of them, without a master."""

import json

import pytest

pytest.importorskip("rospy")

from std_msgs.msg import String
from visualization_msgs.msg import Marker

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import InputError
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.ros.zones import changed, heard_zones, zone_markers

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
