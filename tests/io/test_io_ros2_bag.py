"""ROS 2 bags in both of their formats."""

import re
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from ros2_bags import SCENE, image, info, odometry
from ros2_bags import write as write_messages
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from vsx_ros.cli.main import execute
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording

COUNT = 5


def write(path, plugin, mode=CompressionMode.NONE):
    messages = [("/camera/camera_info", info())]
    for i in range(COUNT):
        messages += [("/odom", odometry(i * 10**8, 0.02 * i)), ("/camera/image_raw", image(i * 10**8 + 5 * 10**7))]
    return write_messages(path, messages, plugin, mode)


def check(recording):
    frames = list(recording.frames())
    assert [f.stamp_ns for f in frames] == [i * 10**8 + 5 * 10**7 for i in range(COUNT)]
    assert all(np.array_equal(f.image, SCENE) for f in frames)
    assert (recording.camera.fx, recording.camera.distortion[0]) == (30.0, 0.1)
    assert [o.T_odom_base.x for o in recording.odometry] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08])
    assert recording.frame_count == COUNT
    assert recording.damage == ""


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_folder_and_its_file_are_the_same_recording(tmp_path, plugin):
    folder = write(tmp_path / "drive", plugin)
    check(open_recording(folder))
    [file] = [path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")]
    check(open_recording(file))


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_compressed(tmp_path, plugin, mode):
    check(open_recording(write(tmp_path / "drive", plugin, mode)))


def test_a_folder_without_its_file_is_one_sentence(tmp_path):
    folder = write(tmp_path / "drive", StoragePlugin.SQLITE3)
    next(folder.glob("*.db3")).unlink()
    with pytest.raises(InputError, match=r"missing.*ros2 bag reindex"):
        open_recording(folder)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_folder_of_a_killed_recorder_names_its_file_and_the_remedy(tmp_path, capsys, plugin):
    folder = write(tmp_path / "drive", plugin)
    (folder / "metadata.yaml").unlink()
    [file] = folder.iterdir()
    with pytest.raises(InputError, match=rf"drive has {file.name} but no metadata.*'ros2 bag reindex {folder}'"):
        open_recording(folder)
    assert execute(["calibrate", "camera", str(folder), "--board", "8x6x0.03"]) == 1
    assert "ros2 bag reindex" in capsys.readouterr().err
    check(open_recording(file))
    (folder / "rgb.txt").write_text("0 a.png\n")
    assert open_recording(folder).frame_count == 1


@pytest.mark.parametrize("tables", [True, False])
def test_messages_beside_a_database_are_told(tmp_path, tables):
    folder, killed = write(tmp_path / "drive", StoragePlugin.SQLITE3), tmp_path / "killed"
    with closing(sqlite3.connect(folder / "drive.db3")) as base:
        base.execute("PRAGMA journal_mode=WAL")
        if not tables:
            base.execute("ALTER TABLE topics RENAME TO other")
            base.commit()
            base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            base.execute("ALTER TABLE other RENAME TO topics")
        else:
            base.execute(
                "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, 9999, data FROM messages WHERE "
                "topic_id = (SELECT id FROM topics WHERE name = '/camera/image_raw')"
            )
        base.commit()
        shutil.copytree(folder, killed)
    remedy = r"put in the messages of drive.db3-wal with sqlite3 '(\S*)' 'PRAGMA wal_checkpoint\(TRUNCATE\)'"
    for given in (killed, killed / "drive.db3"):
        if tables:
            recording = open_recording(given)
            assert recording.frame_count == COUNT
            said = recording.damage
            assert "lacks its last messages" in said
        else:
            with pytest.raises(InputError) as caught:
                open_recording(given)
            said = str(caught.value)
        named = re.search(remedy, said)[1]
    with closing(sqlite3.connect(named)) as base:
        base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    recording = open_recording(killed / "drive.db3")
    assert (recording.frame_count, recording.damage) == (2 * COUNT if tables else COUNT, "")


@pytest.mark.parametrize(
    ("plugin", "remedy"),
    [
        (StoragePlugin.SQLITE3, r"copy it again, for .* the \.recover of the sqlite3"),
        (StoragePlugin.MCAP, r"'mcap recover \S*drive.mcap -o \S*saved.mcap'"),
    ],
)
def test_a_recording_cut_short_names_what_saves_it(tmp_path, plugin, remedy):
    folder = write(tmp_path / "drive", plugin)
    [file] = [path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")]
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    for given in (file, folder):
        with pytest.raises(InputError, match=remedy):
            open_recording(given)
    (folder / "metadata.yaml").write_text("files: [")
    with pytest.raises(InputError, match="ros2 bag reindex"):
        open_recording(folder)


@pytest.mark.parametrize("profile", ["ros1", "", "protobuf"])
def test_an_mcap_file_of_something_else_is_no_damage(tmp_path, profile):
    folder = write(tmp_path / "drive", StoragePlugin.MCAP)
    [file] = folder.glob("*.mcap")
    raw = file.read_bytes()
    length = int.from_bytes(raw[9:17], "little") + len(profile) - 4
    named = length.to_bytes(8, "little") + len(profile).to_bytes(4, "little") + profile.encode()
    file.write_bytes(raw[:9] + named + raw[25:])
    for given in (file, folder):
        with pytest.raises(InputError, match=rf"none of ROS 2 \(its profile is '{profile}'\); give the bag") as caught:
            open_recording(given)
        assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.MESSAGE])
def test_a_row_that_is_cut_short_costs_no_other(tmp_path, mode):
    folder = write(tmp_path / "drive", StoragePlugin.SQLITE3, mode)
    with closing(sqlite3.connect(folder / "drive.db3")) as base, base:
        base.execute("UPDATE messages SET data = substr(data, 1, 60) WHERE id IN (4, 5)")
    recording, told = open_recording(folder), []
    assert len(recording.odometry) == COUNT - 1
    assert recording.damage.startswith("1 of 5 readings of /odom left out, as they cannot be used; the first: mess")
    assert len(list(replace(recording, tell=told.append).frames())) == COUNT - 1
    assert "1 of 5 images left out, as they cannot be used; the first: message 1 of topic /camera/image_raw" in told[0]


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_a_damaged_chunk_of_mcap_costs_no_other(tmp_path, mode):
    noise = np.random.default_rng(0).integers(0, 256, (480, 640), dtype=np.uint8)
    messages = [("/camera/image_raw", image(k, noise)) for k in range(1, 11)]
    [file] = write_messages(tmp_path / "drive", messages, StoragePlugin.MCAP, mode).glob("*.mcap")
    raw = bytearray(file.read_bytes())
    packed = mode is CompressionMode.STORAGE  # then the sign of zstd, else the length of an image's record
    at = raw.index(b"\x28\xb5\x2f\xfd", len(raw) // 4) if packed else raw.index(b"mono8", len(raw) // 2) - 58
    raw[at : at + 4] = b"\xff" * 4
    file.write_bytes(raw)
    told: list[str] = []
    frames = [frame.stamp_ns for frame in replace(open_recording(file), tell=told.append).frames()]
    assert 5 <= len(frames) < 10
    assert (frames[0], frames[-1]) == (1, 10)
    assert f"{10 - len(frames)} of 10 images left out, as they cannot be used; the first: message " in told[0]


def test_of_a_damaged_chunk_no_more_messages_are_lost_than_the_file_can_have(tmp_path):
    messages = [("/i", image(k, np.full((480, 640), k, np.uint8))) for k in range(1, 11)]
    [file] = write_messages(tmp_path / "drive", messages, StoragePlugin.MCAP, CompressionMode.STORAGE).glob("*.mcap")
    raw = bytearray(file.read_bytes())
    raw[raw.rindex(b"\x28\xb5\x2f\xfd")] = 0
    at = raw.rindex(b"\x04\0\0\0zstd")  # behind the length of the last chunk's index
    raw[at - 8 : at] = (2**60).to_bytes(8, "little")
    file.write_bytes(raw)
    told: list[str] = []
    frames = list(replace(open_recording(file), tell=told.append).frames())
    assert 0 < len(frames) < 10
    assert int(told[0].partition(": ")[2].split()[0]) <= len(raw) // 16


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_random_damage_never_escapes_as_another_exception(tmp_path, plugin):
    folder = write(tmp_path / "drive", plugin)
    [file] = [path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")]
    whole, rng = file.read_bytes(), np.random.default_rng(5)
    refused = 0
    for trial in range(80):
        raw = bytearray(whole)
        for position in rng.integers(20, len(raw), 20):
            raw[position] = rng.integers(256)
        cut = len(raw) if trial % 2 else int(rng.integers(20, len(raw)))
        file.write_bytes(raw[:cut])
        try:
            list(open_recording(file if trial % 4 else folder).frames())
        except (InputError, CalibrationError):
            refused += 1
    assert refused > 20
