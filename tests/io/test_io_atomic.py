"""Files that are whole or not there, on the system's own full disk."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.cli import main
from vsx_ros.errors import ConfigError, MapFileError
from vsx_ros.geometry.camera import kernel_camera, nominal_camera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.atomic import replacing, write_bytes
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.io.dock_file import dock_file, save_dock
from vsx_ros.io.map_file import load_map, save_map
from vsx_ros.io.room_file import load_rooms, save_rooms
from vsx_ros.io.slam_map_file import save_slam_map
from vsx_ros.io.zone_file import save_zones
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import RoomMap
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.saved_map import save_continued
from vsx_ros.runs.world import save_world
from vsx_ros.sim.generate import generate_world
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.vision.corners import no_corners
from vsx_ros.vision.pyramid import build_pyramid, small_image

FULL = Path("/dev/full")
CAMERA = nominal_camera(160, 120)


def one_keyframe():
    world, pyramid = Map(), build_pyramid(np.zeros((120, 160), np.uint8))
    frame = FrameData(0, pyramid, no_corners(pyramid), small_image(pyramid), None, kernel_camera(CAMERA))
    world.add_keyframe(frame, SE3.identity(), Observations.none())
    return SlamMap(CAMERA, None, world.view())


def test_a_failed_write_leaves_what_was_there_and_nothing_beside_it(tmp_path):
    file = tmp_path / "map"
    write_bytes(file, b"before")
    (tmp_path / ".map.part").symlink_to(FULL)
    with pytest.raises(OSError) as caught:
        write_bytes(file, b"after")
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(file))
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_world_that_cannot_be_written_leaves_the_one_that_was_there(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("mine")
    (tmp_path / ".mine.yaml.part").symlink_to(FULL)
    with pytest.raises(ConfigError, match="No space left"):
        save_world(generate_world("corridor", 0), file)
    assert file.read_text() == "mine"


def test_a_map_is_not_saved_when_what_goes_with_it_cannot_be_read(tmp_path):
    before, out = tmp_path / "lab.vsxmap", tmp_path / "other.vsxmap"
    dock_file(before).write_text("damaged")
    with pytest.raises(MapFileError, match="lab_dock"):
        save_continued(one_keyframe(), before, out)
    assert list(tmp_path.iterdir()) == [dock_file(before)]


GRID = OccupancyGrid(np.zeros((4, 5), np.int8), 0.05, 0.0, 0.0)
ROOMS = RoomMap(GRID, np.zeros((4, 5), np.int32), ())
PAIRS = {
    "map.yaml": (lambda path: save_map(GRID, path), load_map),
    "map_rooms.json": (lambda path: save_rooms(ROOMS, path), load_rooms),
}


@pytest.mark.parametrize("name", PAIRS)
def test_of_two_files_the_one_that_names_the_other_is_never_of_another_time(name, tmp_path, monkeypatch):
    """Killed before any renaming: both old, or the first file gone."""
    save, load = PAIRS[name]
    file, replace = tmp_path / name, os.replace
    for renamed in range(3):
        file.write_text("old")
        file.with_suffix(".pgm").write_text("old")
        left = [replace] * renamed + [None]

        def killed(source, target, left=left):
            if left[0] is None:
                raise KeyboardInterrupt
            left.pop(0)(source, target)

        monkeypatch.setattr(os, "replace", killed)
        if renamed < 2:
            with pytest.raises(KeyboardInterrupt):
                save(file)
            assert not file.exists()
        else:
            save(file)
            assert load(file) is not None
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({file.with_suffix(".pgm").name, name})


@pytest.mark.parametrize(
    ("name", "full"),
    [("map.yaml", ".yaml"), ("map.yaml", ".pgm"), ("map_rooms.json", ".json"), ("map_rooms.json", ".pgm")],
)
def test_on_a_full_disk_both_files_stay(name, full, tmp_path):
    file = tmp_path / name
    pair = [file, file.with_suffix(".pgm")]
    for path in pair:
        path.write_text("old")
    (tmp_path / f".{file.with_suffix(full).name}.part").symlink_to(FULL)
    with pytest.raises(MapFileError, match="cannot be written"):
        PAIRS[name][0](file)
    assert [path.read_text() for path in pair] == ["old", "old"]


def test_a_device_or_a_pipe_is_never_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a device or a pipe, not a file"):
        write_bytes(tmp_path / "pipe", b"text")
    assert [path.is_fifo() for path in tmp_path.iterdir()] == [True]


def test_a_file_that_could_not_be_made_leaves_what_was_there(tmp_path):
    file = tmp_path / "map"
    write_bytes(file, b"before")
    with pytest.raises(TypeError), replacing(file) as new:
        new.writelines([b"half", None])
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_durable_file_and_its_name_are_brought_to_the_disk(tmp_path, monkeypatch):
    brought: list[tuple[str, list[str]]] = []
    sync = os.fsync

    def watched(descriptor):
        there = sorted(path.name for path in tmp_path.iterdir())
        brought.append((Path(f"/proc/self/fd/{descriptor}").readlink().name, there))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    write_bytes(tmp_path / "map", b"map", durable=True)
    assert brought == [(".map.part", [".map.part"]), (tmp_path.name, ["map"])]


@pytest.mark.parametrize(
    "save",
    [
        lambda path: save_slam_map(one_keyframe(), path),
        lambda path: save_zones([Zone("stairs", ZoneKind.WALL, ((0.0, 0.0), (1.0, 0.0)))], path),
        lambda path: save_dock(SE2(1.0, 2.0, 0.5), path),
        lambda path: save_rooms(
            RoomMap(OccupancyGrid(np.zeros((4, 5)), 0.05, 0.0, 0.0), np.zeros((4, 5), int), ()), path
        ),
        lambda path: write_calibration(path, CAMERA),
    ],
    ids=["map", "zones", "dock", "rooms", "calibration"],
)
def test_what_a_later_run_needs_is_on_the_disk_when_it_is_called_saved(save, tmp_path, monkeypatch):
    """Robots are switched off at the battery, often just after the map was saved."""
    brought = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: brought.append(Path(f"/proc/self/fd/{descriptor}").readlink()))
    save(tmp_path / "saved.json")
    assert {tmp_path / f".{path.name}.part" for path in tmp_path.iterdir()} | {tmp_path} == set(brought)


def test_a_command_on_a_full_disk_says_so(tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    (run / "config.yaml").write_text("config: {}\nversions: {}\n", encoding="utf-8")
    (run / ".config.yaml.part").symlink_to(FULL)
    assert main.execute(["explore", "--fast", "--time", "1", "--out", str(run)]) == 1
    assert "config.yaml cannot be used (No space left on device); free some space" in capsys.readouterr().err
