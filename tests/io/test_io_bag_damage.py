"""Bags that are cut short, damaged, or none: what is whole is used, and the rest is one sentence."""

import struct

import numpy as np
import pytest
from ros1_bags import T, compressed, header, image, info, odometry, write, write_drive
from rosbags.rosbag1 import Writer

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording


@pytest.fixture
def drive(tmp_path):
    return write_drive(tmp_path / "drive.bag")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty .0 bytes."),
        (b"#ROSRECORD V1.2\n" + bytes(100), "format 1.2"),
        (b"#ROSBAG V2.0\n" + bytes(100), "damaged"),
        (b"PK\x03\x04" + bytes(100), "not a bag"),
        (b"SQLite format 3\x00" + bytes(100), "rename it to .*db3"),
    ],
)
def test_what_is_no_bag_is_one_sentence(tmp_path, content, message):
    path = tmp_path / "x.bag"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)


@pytest.fixture(
    scope="module",
    params=[None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4],
    ids=["none", "bz2", "lz4"],
)
def long_drive(tmp_path_factory, request):
    """Several chunks."""
    texture = np.random.default_rng(0).integers(0, 256, (480, 640), dtype=np.uint8)
    messages = [("/camera/rgb/camera_info", info(width=640))]
    messages[0][1].height = 480
    for i in range(10):
        messages.append(("/odom", odometry(i * 10**8, 0.02 * i)))
        messages.append(("/camera/rgb/image_raw", image(i * 10**8 + 1, texture, height=480, width=640)))
    return write(tmp_path_factory.mktemp("long") / "drive.bag", messages, request.param)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.99])
def test_of_a_truncated_bag_the_whole_messages_are_used(tmp_path, long_drive, share):
    frames = list(open_recording(long_drive).frames())
    assert len(frames) == 10
    whole = long_drive.read_bytes()
    path = tmp_path / "t.bag"
    path.write_bytes(whole[: int(share * len(whole))])
    recording = open_recording(path)
    assert "cut short or damaged" in recording.damage
    assert "rosbag reindex" in recording.damage
    rescued = list(recording.frames())
    assert 10 * share - 4 <= len(rescued) <= min(10, 10 * share + 1)
    assert [f.stamp_ns for f in rescued] == [f.stamp_ns for f in frames[: len(rescued)]]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(rescued, frames))
    assert recording.camera.fx == 30.0
    assert len(recording.odometry) in (len(rescued), len(rescued) + 1)


def test_a_bag_without_one_whole_message_is_one_sentence(tmp_path, drive):
    path = tmp_path / "t.bag"
    path.write_bytes(drive.read_bytes()[:4200])
    with pytest.raises(InputError, match="rosbag reindex"):
        list(open_recording(path).frames())


def test_a_good_bag_has_no_damage(drive):
    assert open_recording(drive).damage == ""


def test_a_wrong_index_length_does_no_harm(tmp_path, drive):
    raw = bytearray(drive.read_bytes())
    index_record = raw.index(b"op=\x04") + 4
    data_length = raw.index(struct.pack("<I", 12), index_record)
    raw[data_length : data_length + 4] = struct.pack("<I", 13)
    path = tmp_path / "w.bag"
    path.write_bytes(raw)
    recording = open_recording(path)
    assert "index contradicts itself" in recording.damage
    assert [f.stamp_ns for f in recording.frames()] == [f.stamp_ns for f in open_recording(drive).frames()]
    assert len(recording.odometry) == 5


def test_a_damaged_picture_is_named(tmp_path):
    broken = T["sensor_msgs/msg/CompressedImage"](header(7), "jpeg", np.arange(50, dtype=np.uint8))
    path = write(tmp_path / "b.bag", [("/i/compressed", compressed(1)), ("/i/compressed", broken)])
    with pytest.raises(InputError, match="image 1 of topic /i/compressed"):
        list(open_recording(path).frames())


def test_random_damage_never_escapes_as_another_exception(tmp_path, drive):
    whole = drive.read_bytes()
    rng = np.random.default_rng(5)
    path = tmp_path / "r.bag"
    refused = 0
    for _ in range(60):
        raw = bytearray(whole)
        for position in rng.integers(13, len(raw), 20):
            raw[position] = rng.integers(256)
        path.write_bytes(raw)
        try:
            list(open_recording(path).frames())
        except (InputError, CalibrationError):
            refused += 1
    assert 8 < refused < 60


@pytest.mark.parametrize("topic", ["/odom", "/ground_truth/camera"])
def test_a_pose_that_is_not_finite_is_one_sentence(tmp_path, topic):
    moved = odometry(1, np.nan)
    said = moved if topic == "/odom" else T["geometry_msgs/msg/PoseStamped"](header(1), moved.pose.pose)
    messages = [("/camera/rgb/camera_info", info()), ("/camera/rgb/image_raw", image(1)), (topic, said)]
    with pytest.raises(InputError, match=f"topic {topic} holds a pose that is not finite"):
        open_recording(write(tmp_path / "n.bag", messages))
