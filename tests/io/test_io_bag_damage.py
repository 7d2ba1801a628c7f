"""Bags that are cut short, damaged, or none: what is whole is used, and the rest is one sentence."""

import re
import struct
from dataclasses import replace

import numpy as np
import pytest
from ros1_bags import SCENE, T, compressed, header, image, info, odometry, write
from rosbags.rosbag1 import Writer

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording


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


def read(recording):
    """The stamps of a recording's images, and what it tells."""
    said: list[str] = []
    frames = [frame.stamp_ns for frame in replace(recording, tell=said.append).frames()]
    return frames, said


def test_a_damaged_picture_is_named_and_costs_no_other(tmp_path):
    broken = T["sensor_msgs/msg/CompressedImage"](header(7), "jpeg", np.arange(50, dtype=np.uint8))
    path = write(tmp_path / "b.bag", [("/i/compressed", m) for m in (compressed(1), broken, compressed(9))])
    frames, [said] = read(open_recording(path))
    assert frames == [1, 9]
    assert "b.bag: 1 of 3 images left out, as they cannot be used; the first: image 1 of topic /i/compressed" in said


def test_raw_images_that_are_cut_or_change_cost_no_other(tmp_path):
    cut = image(2)
    cut.data = cut.data[:-1]
    small = image(3, SCENE[:12, :16].copy(), height=12, width=16)
    unknown = image(4, encoding="32FC1")
    messages = [image(1), cut, small, unknown, image(5, np.dstack([SCENE] * 3), "bgr8"), image(6)]
    path = write(tmp_path / "b.bag", [("/c/camera_info", info()), *(("/c/image_raw", m) for m in messages)])
    frames, [said] = read(open_recording(path))
    assert frames == [1, 5, 6]
    assert "3 of 6 images left out" in said
    assert "image 1 of topic /c/image_raw of 32x24 mono8 with 32 bytes a row" in said


def test_where_no_picture_can_be_used_the_first_is_named(tmp_path):
    broken = T["sensor_msgs/msg/CompressedImage"](header(7), "jpeg", np.arange(50, dtype=np.uint8))
    path = write(tmp_path / "b.bag", [("/i/compressed", broken)] * 3)
    with pytest.raises(InputError, match="of the first 3 images none can be used: image 0 of topic /i/compressed"):
        list(open_recording(path).frames())
    path = write(tmp_path / "c.bag", [("/i/compressed", broken)] * 150 + [("/i/compressed", compressed(9))])
    with pytest.raises(InputError, match="of the first 100 images none can be used"):
        list(open_recording(path).frames())


def test_damage_in_the_middle_of_a_bag_costs_no_more_than_its_chunk(tmp_path, long_drive):
    whole = [frame.stamp_ns for frame in open_recording(long_drive).frames()]
    raw = bytearray(long_drive.read_bytes())
    chunks = [m.end() for m in re.finditer(b"op=\x05", raw)]
    at = chunks[len(chunks) // 2] + 100
    raw[at : at + 2000] = bytes(2000)
    path = tmp_path / "m.bag"
    path.write_bytes(raw)
    recording = open_recording(path)
    lost = len(whole) - len(recording.odometry)
    assert 0 < lost < len(whole) / 2
    assert re.match(
        rf"{lost} of 10 readings of /odom left out, as they cannot be used; the first: message \d of topic /odom of "
        r"bag \S*m.bag cannot be read \(", recording.damage
    )  # fmt: skip
    frames, [told] = read(recording)
    assert 0 < len(whole) - len(frames) < len(whole) / 2
    assert frames[-1] == whole[-1]
    assert set(frames) < set(whole)
    assert f"m.bag: {len(whole) - len(frames)} of 10 images left out, as they cannot be used; the first: mess" in told


@pytest.mark.parametrize("index", [True, False])
def test_a_message_with_a_wrong_length_costs_no_other(tmp_path, drive, index):
    raw = bytearray(drive.read_bytes())
    images = [m.end() for m in re.finditer(b"mono8", raw)]
    raw[images[2] + 7] ^= 0x40  # of the number of its bytes, after big endian and step
    camera = raw.index(b"plumb_bob") + len(b"plumb_bob")
    raw[camera + 2] ^= 0x40  # of the number of coefficients
    path = tmp_path / "m.bag"
    path.write_bytes(raw if index else raw.replace(b"index_pos=", b"index_pus="))
    recording = open_recording(path)
    assert recording.camera is None
    assert ("damaged" in recording.damage) is not index
    frames, [told] = read(recording)
    assert frames == [k * 10**8 + 5 * 10**7 for k in (0, 1, 3, 4)]
    assert "1 of 5 images left out, as they cannot be used; the first: message 2 of topic /camera/rgb/image_raw" in told


def test_random_damage_never_escapes_as_another_exception(tmp_path, drive):
    whole = drive.read_bytes()
    rng = np.random.default_rng(5)
    path = tmp_path / "r.bag"
    refused = 0
    for _ in range(60):
        raw = bytearray(whole)
        for position in rng.integers(13, len(raw), 40):
            raw[position] = rng.integers(256)
        path.write_bytes(raw)
        try:
            list(open_recording(path).frames())
        except (InputError, CalibrationError):
            refused += 1
    assert 8 < refused < 60


def with_pose(topic, moved):
    """The message for one of the topics with this odometry."""
    return topic, moved if topic == "/odom" else T["geometry_msgs/msg/PoseStamped"](moved.header, moved.pose.pose)


def no_rotation(stamp_ns):
    moved = odometry(stamp_ns, 0.0)
    moved.pose.pose.orientation.w = 0.0
    return moved


@pytest.mark.parametrize("topic", ["/odom", "/ground_truth/camera"])
@pytest.mark.parametrize(
    ("wrong", "why"), [(odometry(2, np.nan), "a pose that is not finite"), (no_rotation(2), "is no rotation")]
)
def test_a_pose_that_cannot_be_is_left_out_and_told(tmp_path, topic, wrong, why):
    camera = [("/camera/rgb/camera_info", info()), ("/camera/rgb/image_raw", image(1))]
    good = [with_pose(topic, odometry(stamp_ns, 0.0)) for stamp_ns in (1, 3)]
    recording = open_recording(write(tmp_path / "n.bag", [*camera, good[0], with_pose(topic, wrong), good[1]]))
    assert [pose.stamp_ns for pose in (*recording.odometry, *recording.ground_truth)] == [1, 3]
    assert re.match(
        f"1 of 3 (readings|poses) of {topic} left out, as they cannot be used; the first: ", recording.damage
    )
    assert why in recording.damage
    recording = open_recording(write(tmp_path / "a.bag", [*camera, with_pose(topic, wrong)]))
    assert (recording.odometry, recording.odometry_topic, recording.ground_truth) == ([], None, [])
    assert re.match(f"1 of 1 (readings|poses) of {topic} left out", recording.damage)
    assert len(list(recording.frames())) == 1
