"""ROS 2 bags, written here by rosbags' writer in both of its formats."""

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording

TYPES = get_typestore(Stores.ROS2_HUMBLE)
T = TYPES.types
SCENE = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)
COUNT = 5


def header(stamp_ns):
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "cam")


def image(stamp_ns):
    return T["sensor_msgs/msg/Image"](header(stamp_ns), 24, 32, "mono8", 0, 32, SCENE.ravel())


def info():
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    k, r = np.array([30.0, 0, 15.5, 0, 30.0, 11.5, 0, 0, 1.0]), np.eye(3).ravel()
    d = np.array([0.1, 0, 0, 0, 0])
    return T["sensor_msgs/msg/CameraInfo"](header(1), 24, 32, "plumb_bob", d, k, r, np.zeros(12), 0, 0, roi)


def odometry(stamp_ns, x):
    point, quaternion = T["geometry_msgs/msg/Point"](x, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1.0)
    vector, zeros = T["geometry_msgs/msg/Vector3"], np.zeros(36)
    pose = T["geometry_msgs/msg/PoseWithCovariance"](T["geometry_msgs/msg/Pose"](point, quaternion), zeros)
    twist = T["geometry_msgs/msg/Twist"](vector(0.2, 0, 0), vector(0, 0, 0.1))
    with_covariance = T["geometry_msgs/msg/TwistWithCovariance"](twist, zeros)
    return T["nav_msgs/msg/Odometry"](header(stamp_ns), "base", pose, with_covariance)


def write(path, plugin, mode=CompressionMode.NONE):
    messages = [("/camera/camera_info", info())]
    for i in range(COUNT):
        messages += [("/odom", odometry(i * 10**8, 0.02 * i)), ("/camera/image_raw", image(i * 10**8 + 5 * 10**7))]
    writer = Writer(path, version=8, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for index, (topic, message) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], 1000 + index, TYPES.serialize_cdr(message, kind))
    return path


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
