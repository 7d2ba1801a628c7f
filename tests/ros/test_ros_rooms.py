"""Names of rooms survive a run that is killed, without a master."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from two_rooms import two_rooms

from vsx_ros.config import Config
from vsx_ros.ros import headers, topics
from vsx_ros.ros.rooms import RoomServer


def test_a_name_is_kept_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    heard = {topics.ROOMS: told.append}
    monkeypatch.setattr(
        rospy, "Publisher", lambda topic, *_, **__: SimpleNamespace(publish=heard.get(topic, lambda _: None))
    )
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    monkeypatch.setattr(headers, "now_ns", lambda: 0)
    map_file = tmp_path / "map.yaml"
    killed = RoomServer(Config(), map_file, map_file)
    killed.update(two_rooms(), None)
    assert "kitchen" in killed._name(json.dumps({"room": 2, "name": "kitchen"}))
    RoomServer(Config(), map_file, map_file).update(two_rooms(), None)
    assert [room["name"] for room in json.loads(told[-1])["rooms"]] == ["room 1", "kitchen"]
