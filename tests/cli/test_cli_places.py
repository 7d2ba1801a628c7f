"""``vsx zone`` and ``vsx room`` beside a saved map: what they print, write and refuse."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from two_rooms import two_rooms

from vsx_ros.cli.main import execute
from vsx_ros.config import Config, RoomsConfig
from vsx_ros.errors import MapFileError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.map_file import load_map, save_map
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.grid import FREE
from vsx_ros.occupancy.rooms import RoomTracker
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.checkpoint import digests
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import place_files, places_of


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
        "hall (slow, at most 0.1 m/s): 0.00,0.00 1.00,0.00 1.00,1.00",
        "rug (wall): 0.00,0.00 1.00,0.00",
    ]
    assert execute(["zone", "add", "rug", "wall", "0,0", "-1,0", *beside]) == 0  # without quotes
    assert load_zones(zone_file(map_file))[1].points == ((0.0, 0.0), (-1.0, 0.0))
    capsys.readouterr()
    assert execute(["zone", "list", "--json", *beside]) == 0
    assert [tree["name"] for tree in json.loads(capsys.readouterr().out)] == ["hall", "rug"]
    assert execute(["zone", "remove", "rug", *beside]) == 0
    assert [zone.name for zone in load_zones(zone_file(map_file))] == ["hall"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["add", "rug", "no-go", "0,0 1,0"], "has 2 corners; the kind no-go needs at least 3, e.g. '1,2 3,2 3,4' in"),
        (["add", "rug", "wall", "0,0"], "has 1 corner; the kind wall needs at least 2, e.g. '1,2 3,2' in metres"),
        (["add", "rug", "no-go", "0,0 1,0 1"], "each is a pair"),
        (["add", "rug", "no-go", "0,0 1,0 a,b"], "in quotes"),
        (["add", "rug", "slow", "0,0 1,0 1,1"], "a slow zone needs its speed: add --speed 0.1"),
        (["add", "rug", "no-go", "0,0 1,0 1,1", "--speed", "0.1"], "a speed v_m_s belongs"),
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
    map_file.rename(map_file.with_name("map.yaml"))
    for end in ("json", "pgm"):
        (map_file.parent / f"flat_rooms.{end}").rename(map_file.parent / f"map_rooms.{end}")
    assert execute(["room", "list", "--map", str(map_file.parent)]) == 0
    assert capsys.readouterr().out.splitlines() == lines
    beside = ["--map", str(map_file.parent)]
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


AHEAD = """version: 1
zones:
- {name: rug, kind: no-go, points: [[0.45, -0.6], [2, -0.6], [2, 0.6], [0.45, 0.6]]}
"""


@pytest.fixture(scope="module")
def zoned_run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Four seconds with a zone right ahead."""
    folder = tmp_path_factory.mktemp("zoned")
    (folder / "mine.yaml").write_text(AHEAD)
    given = ["--zones", str(folder / "mine.yaml")]
    assert execute(["explore", "--fast", "--seed", "3", "--time", "4", "--out", str(folder / "run"), *given]) == 0
    return RunFolder(folder / "run")


def test_zones_given_at_the_start_hold_from_the_first_metre(zoned_run: RunFolder) -> None:
    driven = [pose.T.translation[0] for pose in zoned_run.read_poses("odometry")]
    assert max(driven) < 0.45 - Config().robot.radius_m
    assert min(driven) < -0.2
    given = Path(zoned_run.read_config()[1]["zones"])
    (written,) = load_zones(zone_file(zoned_run.path / "map.yaml"))
    assert written.name == "rug"
    assert np.array(written.points) == pytest.approx(np.array(load_zones(given)[0].points), abs=0.02)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--seed", "3", "--zones", "nowhere.yaml"], "there is no file of zones"),
        (["--resume", "RUN", "--zones", "nowhere.yaml"], "leave out --zones"),
    ],
)
def test_zones_that_cannot_be_taken_are_told(
    zoned_run: RunFolder, words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(zoned_run.path) if word == "RUN" else word for word in words]
    assert execute(["explore", "--fast", *given]) == 1
    assert says in capsys.readouterr().err


def test_zones_rooms_and_dock_go_with_a_map_that_is_saved_and_exported(
    zoned_run: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    beside, lab = ["--map", str(zoned_run.path / "map.yaml")], tmp_path / "lab.vsxmap"
    assert execute(["room", "name", "1", "kitchen", *beside]) == 0
    assert execute(["zone", "add", "door", "wall", "-2,-2 -2,2", *beside]) == 0
    save_dock(SE2(1.0, -0.5, 2.0), dock_file(zoned_run.path / "map.yaml"))
    for words in (["save", str(zoned_run.path), "--out", str(lab)], ["export", str(lab), "--format", "pgm"]):
        assert execute(["map", *words]) == 0
    ground = tmp_path / "lab_ground.yaml"
    for map_file in (lab, ground):
        rooms = load_rooms(room_file(map_file))
        assert rooms is not None
        assert [room.name for room in rooms.rooms] == ["kitchen"]
        assert [zone.name for zone in load_zones(zone_file(map_file))] == ["rug", "door"]
        assert load_dock(dock_file(map_file)) == SE2(1.0, -0.5, 2.0)
    assert rooms.labels.shape == load_map(ground).shape
    killed = tmp_path / "killed"
    shutil.copytree(zoned_run.path / "resume", killed / "resume")
    shutil.copy(zoned_run.path / "config.yaml", killed)
    assert execute(["map", "save", str(killed), "--out", str(lab)]) == 0
    assert [zone.name for zone in load_zones(zone_file(lab))] == ["rug"]
    assert load_dock(dock_file(lab)) is None


def copied(run: RunFolder, to: Path) -> RunFolder:
    shutil.copytree(run.path, to)
    return RunFolder(to)


def listed(run: RunFolder, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The names that 'vsx zone list' tells."""
    capsys.readouterr()
    assert execute(["zone", "list", "--json", "--map", str(run.path)]) == 0
    return [tree["name"] for tree in json.loads(capsys.readouterr().out)]


def test_zones_and_dock_changed_beside_a_run_hold_in_its_next_session_and_stay(
    zoned_run: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also with the clock of a robot that has no battery for it, or in a copy without its times."""
    run = copied(zoned_run, tmp_path / "run")
    beside = ["--map", str(run.path)]
    assert execute(["zone", "add", "stairs", "no-go", "3,3 4,3 4,4", *beside]) == 0
    os.utime(zone_file(run.path / "map.yaml"), (1, 1))
    assert "stairs" in listed(run, capsys)
    assert execute(["zone", "remove", "rug", *beside]) == 0
    save_dock(SE2(1.0, -0.5, 2.0), dock_file(run.path / "map.yaml"))
    for path in place_files(run):
        os.utime(path, (1, 1))
    assert execute(["explore", "--fast", "--resume", str(run.path), "--time", "6"]) == 0
    for zones in (load_zones(zone_file(run.path / "map.yaml")), places_of(run, run.checkpoint.read())[0]):
        names = [zone.name for zone in zones]
        assert "stairs" in names
        assert "rug" not in names
    docked = places_of(run, run.checkpoint.read())[1]
    assert docked is not None
    assert docked.distance_to(SE2(1.0, -0.5, 2.0)) < 0.02


@pytest.fixture
def killed_later(zoned_run: RunFolder, tmp_path: Path) -> RunFolder:
    """Its last session began with the one zone stairs, and was killed when there was the one zone rug. Copied since,
    the older file last."""
    run = copied(zoned_run, tmp_path / "run")
    zones = zone_file(run.path / "map.yaml")
    save_zones([Zone("stairs", ZoneKind.NO_GO, ((3.0, 3.0), (4.0, 3.0), (4.0, 4.0)))], zones)
    run.checkpoint.write(run.checkpoint.read()._replace(beside=digests([zones])))
    os.utime(zones, (2**31, 2**31))
    return run


def test_zones_with_which_a_killed_session_began_do_not_come_back(
    killed_later: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert listed(killed_later, capsys) == ["rug"]
    assert [zone.name for zone in places_of(killed_later, killed_later.checkpoint.read())[0]] == ["rug"]


def test_drawing_the_zones_with_which_a_killed_session_began_counts(
    killed_later: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    beside = ["--map", str(killed_later.path)]
    assert execute(["zone", "add", "stairs", "no-go", "3,3 4,3 4,4", *beside]) == 0
    assert execute(["zone", "remove", "rug", *beside]) == 0
    assert listed(killed_later, capsys) == ["stairs"]


@pytest.mark.parametrize(("at_s", "names"), [(1, ["rug"]), (2**31, ["stairs"])])
def test_a_checkpoint_of_an_older_version_knows_times_alone(
    killed_later: RunFolder, at_s: int, names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    killed_later.checkpoint.write(killed_later.checkpoint.read()._replace(beside=None))
    os.utime(zone_file(killed_later.path / "map.yaml"), (at_s, at_s))
    assert listed(killed_later, capsys) == names


def test_zones_that_cannot_be_read_are_told_and_not_left_out(
    killed_later: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    zone_file(killed_later.path / "map.yaml").write_bytes(b"\xff")
    assert execute(["zone", "list", "--map", str(killed_later.path)]) == 1
    assert "cannot be read" in capsys.readouterr().err


def test_the_zones_of_a_run_whose_map_was_written_without_them_are_not_lost(
    zoned_run: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As when the process that knows the zones is killed at the end, and another one writes the ground map."""
    run = copied(zoned_run, tmp_path / "run")
    zone_file(run.path / "map.yaml").unlink()
    (run.path / "map.yaml").touch()
    assert execute(["zone", "list", "--map", str(run.path)]) == 0
    assert "rug" in capsys.readouterr().out
    assert execute(["zone", "add", "door", "wall", "-2,-2 -2,2", "--map", str(run.path)]) == 0
    assert execute(["map", "save", str(run.path), "--out", str(tmp_path / "lab.vsxmap")]) == 0
    assert [zone.name for zone in load_zones(zone_file(tmp_path / "lab.vsxmap"))] == ["rug", "door"]


@pytest.mark.parametrize(
    ("option", "name"),
    [
        ("--load-map", "map.vsxmap"),
        ("--zones", "map_zones.yaml"),
        ("--world", "map.yaml"),
        ("--world", "map.pgm"),
        ("--world", "world.yaml"),
    ],
)
def test_a_new_run_does_not_empty_the_folder_of_the_map_it_begins_with(
    zoned_run: RunFolder, tmp_path: Path, option: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(zoned_run, tmp_path / "run")
    assert execute(["map", "save", str(run.path)]) == 0
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    assert execute(["explore", "--fast", option, str(run.path / name), "--out", str(run.path), "--time", "2"]) == 1
    assert "which a new run empties; choose another folder" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()} == before


def test_a_map_saved_over_another_has_no_rooms_of_that(zoned_run: RunFolder, map_file: Path, tmp_path: Path) -> None:
    run, lab = copied(zoned_run, tmp_path / "run"), map_file.with_name("flat.vsxmap")
    room_file(run.path / "map.yaml").unlink()
    assert room_file(lab).exists()
    assert execute(["map", "save", str(run.path), "--out", str(lab)]) == 0
    assert not room_file(lab).exists()
    assert not room_file(lab).with_suffix(".pgm").exists()


def test_a_file_that_is_no_map_gets_no_zones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").touch()
    for words in (["list"], ["add", "rug", "no-go", "0,0 1,0 1,1"]):
        assert execute(["zone", *words, "--map", str(tmp_path / "notes.txt")]) == 1
        assert "is no map; give a .vsxmap, a map.yaml or a run folder" in capsys.readouterr().err


def test_a_map_without_rooms_says_so(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rooms = load_rooms(room_file(map_file))
    assert rooms is not None
    save_rooms(rooms._replace(rooms=(), labels=np.zeros_like(rooms.labels)), room_file(map_file))
    assert execute(["room", "list", "--map", str(map_file)]) == 0
    assert "no rooms yet" in capsys.readouterr().out


def test_a_plan_is_made_in_the_map_of_a_run(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = map_file.parent / "run"
    run.mkdir()
    save_map(load_map(map_file), run / "map.yaml")
    x, y = load_map(map_file).centres(np.argwhere(load_map(map_file).data == FREE)).mean(axis=0)
    pose = f"{x:.2f},{y:.2f},0"
    execute(["plan", "--map", str(run), "--start", pose, "--goal", pose, "--json"])
    assert json.loads(capsys.readouterr().out)["map"] == str(run / "map.yaml")
