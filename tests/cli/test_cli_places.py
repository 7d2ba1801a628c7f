"""``vsx zone`` and ``vsx room`` beside a saved map: what they print, write and refuse."""

import json
from pathlib import Path

import pytest
from two_rooms import two_rooms

from vsx_ros.cli.main import execute
from vsx_ros.config import RoomsConfig
from vsx_ros.errors import MapFileError
from vsx_ros.io.map_file import load_map, save_map
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.zone_file import load_zones, zone_file
from vsx_ros.occupancy.grid import FREE
from vsx_ros.occupancy.rooms import RoomTracker


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    """Two rooms and their files."""
    grid = two_rooms()
    save_map(grid, tmp_path / "flat.yaml")
    save_rooms(RoomTracker(RoomsConfig()).update(grid), room_file(tmp_path / "flat.yaml"))
    return tmp_path / "flat.yaml"


def test_zones_are_drawn_listed_replaced_and_removed(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    beside = ["--map", str(map_file)]
    assert execute(["zone", "list", *beside]) == 0
    assert "no zones" in capsys.readouterr().out
    assert execute(["zone", "add", "rug", "no-go", "-0.5,0 1,0 1,1", *beside]) == 0
    assert "zone 'rug' is drawn: no-go, 3 corners" in capsys.readouterr().out
    assert execute(["zone", "add", "hall", "slow", "0,0 1,0 1,1", "--speed", "0.1", *beside]) == 0
    assert execute(["zone", "add", "rug", "wall", "0,0 1,0", *beside]) == 0
    capsys.readouterr()
    assert execute(["zone", "list", *beside]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "hall: slow at most 0.1 m/s, 0.00,0.00 1.00,0.00 1.00,1.00",
        "rug: wall, 0.00,0.00 1.00,0.00",
    ]
    assert execute(["zone", "list", "--json", *beside]) == 0
    assert [tree["name"] for tree in json.loads(capsys.readouterr().out)] == ["hall", "rug"]
    assert execute(["zone", "remove", "rug", *beside]) == 0
    assert [zone.name for zone in load_zones(zone_file(map_file))] == ["hall"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["add", "rug", "no-go", "0,0 1,0"], "has 2 corners"),
        (["add", "rug", "no-go", "0,0 1,0 1"], "each is a pair"),
        (["add", "rug", "no-go", "0,0 1,0 a,b"], "in quotes"),
        (["add", "rug", "slow", "0,0 1,0 1,1"], "a speed v_m_s belongs"),
        (["remove", "rug"], "no zone 'rug'"),
    ],
)
def test_mistakes_are_told_in_one_sentence(
    map_file: Path, words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["zone", *words, "--map", str(map_file)]) == 1
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1
    assert not zone_file(map_file).exists()


def test_a_misspelt_map_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["zone", "add", "rug", "wall", "0,0 1,0", "--map", str(tmp_path / "flt.yaml")]) == 1
    assert "there is no map" in capsys.readouterr().err


def test_rooms_are_listed_and_named(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    beside = ["--map", str(map_file)]
    assert execute(["room", "name", "2", "kitchen", *beside]) == 0
    assert execute(["room", "name", "Kitchen", "bath", *beside]) == 0
    capsys.readouterr()
    assert execute(["room", "list", *beside]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert "bath" in lines[1]
    assert "100 % known" in lines[1]
    assert execute(["room", "name", "hall", "kitchen", *beside]) == 1
    assert "the rooms are: 'room 1', 'bath'" in capsys.readouterr().err
    assert execute(["explore", "--fast", "--room", "bath"]) == 1
    assert "give it with --load-map" in capsys.readouterr().err


def test_the_room_picture_lies_on_the_map_and_damage_is_told(map_file: Path) -> None:
    rooms, grid = load_rooms(room_file(map_file)), load_map(map_file)
    assert rooms is not None
    assert rooms.labels.shape == grid.shape
    assert ((rooms.labels > 0) == (grid.data == FREE)).all()
    assert (rooms.grid.origin_x, rooms.grid.origin_y) == (-1.0, -2.0)
    for text in ("", "{}", '{"version": 2}', '{"version": 1, "rooms": [1]}', '{"version": 1, "rooms": [{}]}'):
        room_file(map_file).write_text(text)
        with pytest.raises(MapFileError, match="the rooms are found anew"):
            load_rooms(room_file(map_file))
    room_file(map_file).unlink()
    assert load_rooms(room_file(map_file)) is None
