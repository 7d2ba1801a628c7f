"""Zones, rooms and dock of one run and the next: what stays with the map, and what was only this run's."""

from pathlib import Path

import numpy as np
import pytest
from two_rooms import two_rooms

from vsx_ros.config import Config, RoomsConfig
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, save_dock
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.zone_file import load_zones, zone_file
from vsx_ros.occupancy.rooms import RoomTracker
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import begin_places, keep_zones, rooms_known
from vsx_ros.runs.rooms import look_into
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import snapshot


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    """A saved map with rooms, the second of them called kitchen."""
    tracker = RoomTracker(RoomsConfig())
    tracker.update(two_rooms())
    tracker.rename(2, "kitchen")
    assert tracker.current is not None
    save_rooms(tracker.current, room_file(tmp_path / "lab.yaml"))
    return tmp_path / "lab.vsxmap"


def test_the_next_run_explores_more_than_the_room_of_this_one(map_file: Path) -> None:
    ground = MappedGround(Config())
    carpet = Zone("carpet", ZoneKind.LOOK, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    ground.zones.add(carpet)
    look_into(ground, map_file, "Kitchen")
    zones = ground.zones.zones(np.zeros(0, np.int64), [])
    assert [zone.kind for zone in zones] == [ZoneKind.LOOK, ZoneKind.LOOK], "and a resumed one still the room"
    keep_zones(zones, map_file)
    assert load_zones(zone_file(map_file)) == [carpet]


def test_rooms_keep_their_names_from_the_loaded_map_until_the_run_has_its_own(map_file: Path, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    own = folder.path / "map.yaml"
    assert rooms_known(None, "") is None
    assert rooms_known(folder, "") == own
    assert rooms_known(folder, str(map_file)) == map_file
    folder.path.mkdir()
    rooms = load_rooms(room_file(map_file))
    assert rooms is not None
    save_rooms(rooms, room_file(own))
    assert rooms_known(folder, str(map_file)) == own


def test_a_run_begins_with_the_zones_and_the_dock_of_its_map_and_the_zones_of_the_user(
    map_file: Path, tmp_path: Path
) -> None:
    carpet = Zone("carpet", ZoneKind.LOOK, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    keep_zones([carpet, carpet._replace(name="rug")], map_file)
    save_dock(SE2(1.0, -0.5, 2.0), dock_file(map_file))
    keep_zones([carpet._replace(kind=ZoneKind.NO_GO)], tmp_path / "mine.yaml")
    ground, nothing = MappedGround(Config()), snapshot(Map().view())
    begin_places(ground, map_file, zone_file(tmp_path / "mine.yaml"), "kitchen")
    told = {zone.name: zone.kind for zone in ground.zones_in(nothing)}
    assert told == {"carpet": ZoneKind.NO_GO, "rug": ZoneKind.LOOK, "look into kitchen": ZoneKind.LOOK}
    assert ground.dock(nothing) == SE2(1.0, -0.5, 2.0)
