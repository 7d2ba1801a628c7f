"""Good bags that pack a hundredfold and more, as simulated images of plain colour do, and where their limit is."""

from types import SimpleNamespace

import bombs
import numpy as np
import pytest
import ros1_bags
import ros2_bags
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from taken import taken

from vsx_ros.errors import InputError
from vsx_ros.io import bounded_rosbags
from vsx_ros.io.bag import open_recording
from vsx_ros.limits import MIB

WALL = np.full((480, 640, 3), 180, np.uint8)
COUNT = 200  # 184 MB of flat colour


def flat_bag(path, compression):
    images = [("/i", ros1_bags.image(k, WALL, "rgb8", 480, 640)) for k in range(1, COUNT + 1)]
    return ros1_bags.write(path, images, compression)


@pytest.mark.parametrize("how", ["BZ2", "LZ4"])
@pytest.mark.parametrize("index", [True, False])
def test_flat_images_are_no_damage(tmp_path, how, index):
    path = flat_bag(tmp_path / "flat.bag", Writer.CompressionFormat[how])
    if not index:
        path.write_bytes(path.read_bytes()[:-10])
    recording, count = open_recording(path), []
    assert taken(path, lambda _: count.extend(frame.stamp_ns for frame in recording.frames())) == ""
    assert len(count) == COUNT
    assert ("damaged" in recording.damage) is not index


@pytest.mark.parametrize(
    ("plugin", "mode"), [(StoragePlugin.MCAP, CompressionMode.STORAGE), (StoragePlugin.SQLITE3, CompressionMode.FILE)]
)
def test_flat_images_of_ros2_are_no_damage(tmp_path, plugin, mode):
    images = [("/i", ros2_bags.image(k, WALL, "rgb8")) for k in range(1, COUNT + 1)]
    recording = open_recording(ros2_bags.write(tmp_path / "flat", images, plugin, mode))
    assert len(list(recording.frames())) == COUNT
    assert recording.damage == ""


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_packed_file_of_one_enormous_message_takes_no_memory(tmp_path, plugin, monkeypatch):
    monkeypatch.setattr(bounded_rosbags, "_FLOOR", bombs.GIB)
    bombs.ros2_bag(tmp_path / "x", plugin, CompressionMode.FILE, size=2 * bombs.GIB // 3)
    said = taken(tmp_path / "x", lambda p: list(open_recording(p).messages()))
    assert f"{128 * MIB}" in said
    assert "damaged" not in said


def test_a_limit_is_told_as_one(tmp_path, monkeypatch):
    path = flat_bag(tmp_path / "flat.bag", Writer.CompressionFormat.BZ2)
    monkeypatch.setattr(bounded_rosbags, "_FLOOR", 8 * MIB)
    with pytest.raises(InputError, match=r"flat.bag is too large when it is unpacked \(what its chunks .*; cut it"):
        open_recording(path)
    monkeypatch.setattr(bounded_rosbags, "disk_usage", lambda _: SimpleNamespace(free=8 * MIB))
    folder = tmp_path / "x"
    bombs.ros2_bag(folder, StoragePlugin.SQLITE3, CompressionMode.FILE, size=8 * MIB)
    with pytest.raises(InputError, match="x is too large when it is unpacked .*more than half of what is free in .*"):
        open_recording(folder)


@pytest.mark.parametrize("packed", ["chunks", "file"])
def test_a_small_bag_that_unpacks_to_gigabytes_is_refused_soon(tmp_path, packed):
    path = tmp_path / "x"
    if packed == "file":
        bombs.ros2_bag(path, StoragePlugin.SQLITE3, CompressionMode.FILE, size=2 * bombs.GIB // 3)
    else:
        blank = np.zeros((4000, 4000, 3), np.uint8)
        path = ros1_bags.write(
            path,
            [("/i", ros1_bags.image(k, blank, "rgb8", 4000, 4000)) for k in range(1, 9)],
            Writer.CompressionFormat.BZ2,
        )
    with pytest.raises(InputError, match="x is too large when it is unpacked"):
        open_recording(path)
