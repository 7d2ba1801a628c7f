"""Bags are written here by rosbags' writer; the damaged and foreign ones are made by hand."""

import struct

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.recording import open_recording

TYPES = get_typestore(Stores.ROS1_NOETIC)
T = TYPES.types
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
ODOM, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"
SCENE = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)


def header(stamp_ns):
    seconds, rest = divmod(stamp_ns, 10**9)
    return T["std_msgs/msg/Header"](0, T["builtin_interfaces/msg/Time"](seconds, rest), "cam")


def image(stamp_ns, pixels=SCENE, encoding="mono8", height=24, width=32):
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    return T[IMAGE](header(stamp_ns), height, width, encoding, 0, len(data) // height, data)


def compressed(stamp_ns, pixels=SCENE, kind="png"):
    data = cv2.imencode(f".{kind}", pixels)[1].ravel()
    return T["sensor_msgs/msg/CompressedImage"](header(stamp_ns), f"bgr8; {kind} compressed bgr8", data)


def info(fx=30.0, width=32, model="plumb_bob", D=(0.1, 0, 0, 0, 0), rectified_fx=28.0):
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([fx, 0, 15.5, 0, fx, 11.5, 0, 0, 1.0]) if fx else np.zeros(9)
    P = np.array([rectified_fx, 0, 15.0, 0, 0, rectified_fx, 11.0, 0, 0, 0, 1.0, 0])
    return T[INFO](header(1), 24, width, model, np.array(D, float), K, np.eye(3).ravel(), P, 0, 0, roi)


def odometry(stamp_ns, x):
    point, quaternion = T["geometry_msgs/msg/Point"](x, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1.0)
    pose = T["geometry_msgs/msg/Pose"](point, quaternion)
    vector = T["geometry_msgs/msg/Vector3"]
    twist = T[TWIST](vector(0.2, 0, 0), vector(0, 0, 0.1))
    with_covariance = T["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    return T[ODOM](
        header(stamp_ns), "base", with_covariance, T["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
    )


def write(path, messages, compression=None):
    writer = Writer(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for index, (topic, message) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=TYPES)
            raw = TYPES.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[topic], 1000 + index, raw)
    return path


@pytest.fixture
def drive(tmp_path):
    messages = [("/camera/rgb/camera_info", info())]
    for i in range(5):
        messages += [("/odom", odometry(i * 10**8, 0.02 * i)), ("/camera/rgb/image_raw", image(i * 10**8 + 5 * 10**7))]
    return write(tmp_path / "drive.bag", messages)


def test_frames_odometry_and_calibration_are_found_by_type(drive):
    recording = open_recording(drive)
    frames = list(recording.frames())
    assert [f.stamp_ns for f in frames] == [i * 10**8 + 5 * 10**7 for i in range(5)]
    assert all(np.array_equal(f.image, SCENE) for f in frames)
    assert recording.image_topic == "/camera/rgb/image_raw"
    assert (recording.camera.fx, recording.camera.distortion[0]) == (30.0, 0.1)
    assert [o.T_odom_base.x for o in recording.odometry] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08])
    assert (recording.odometry[0].v, recording.odometry[0].omega) == (0.2, 0.1)


def test_messages_interleave_by_stamp(drive):
    stamps = [m.stamp_ns for m in open_recording(drive).messages()]
    assert stamps == sorted(stamps)
    assert len(stamps) == 10


def test_odometry_is_interpolated_within_and_absent_far_outside(drive):
    recording = open_recording(drive)
    assert recording.odometry_at(5 * 10**7).T_odom_base.x == pytest.approx(0.01, abs=1e-6)
    assert recording.odometry_at(6 * 10**8).T_odom_base.x == pytest.approx(0.08)
    assert recording.odometry_at(5 * 10**9) is None


@pytest.mark.parametrize("compression", [Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_compressed_bags_and_images(tmp_path, compression):
    messages = [("/c/image/compressed", compressed(i * 10**7 + 1)) for i in range(3)]
    frames = list(open_recording(write(tmp_path / "c.bag", messages, compression)).frames())
    assert len(frames) == 3
    assert np.array_equal(frames[2].image, SCENE)


def test_an_image_out_of_order_is_left_out(tmp_path):
    stamps = [10, 30, 20, 30, 40]
    path = write(tmp_path / "o.bag", [("/image", image(s)) for s in stamps])
    assert [f.stamp_ns for f in open_recording(path).frames()] == [10, 30, 40]


@pytest.mark.parametrize("wrong", [0, 2, 3])
def test_one_image_from_the_future_costs_no_other(tmp_path, wrong):
    stamps = [10**9 + k * 10**8 for k in range(5)]
    path = write(tmp_path / "f.bag", [("/image", image(s + 10**12 * (k == wrong))) for k, s in enumerate(stamps)])
    assert [f.stamp_ns for f in open_recording(path).frames()] == [s for k, s in enumerate(stamps) if k != wrong]


def test_stampless_images_take_the_time_of_recording(tmp_path):
    path = write(tmp_path / "o.bag", [("/image", image(0)), ("/image", image(0))])
    assert [f.stamp_ns for f in open_recording(path).frames()] == [1000, 1001]


def test_sixteen_bit_images_keep_one_scale(tmp_path):
    first = np.linspace(0, 4095, 24 * 32).astype("<u2")
    path = write(tmp_path / "w.bag", [("/i", image(1, first, "mono16")), ("/i", image(2, first // 2, "mono16"))])
    one, two = (f.image.astype(int) for f in open_recording(path).frames())
    assert one.max() == 255
    assert np.abs(one // 2 - two).max() <= 1


def test_no_image_topic_lists_what_there_is(tmp_path):
    path = write(tmp_path / "n.bag", [("/odom", odometry(1, 0.0))])
    with pytest.raises(InputError, match=r"no image topic; it has /odom \(nav_msgs/Odometry\)"):
        open_recording(path)


def test_two_cameras_must_be_chosen_between(tmp_path):
    path = write(tmp_path / "s.bag", [("/left/image", image(1)), ("/right/image", image(1, SCENE[::-1]))])
    with pytest.raises(InputError, match="--image-topic: /left/image, /right/image"):
        open_recording(path)
    chosen = open_recording(path, image_topic="right/image")
    assert np.array_equal(next(chosen.frames()).image, SCENE[::-1])


def test_a_topic_that_is_not_there_is_named(drive):
    with pytest.raises(InputError, match="no image topic /cam0; it has"):
        open_recording(drive, image_topic="/cam0")
    with pytest.raises(InputError, match="no odometry topic /wheels; it has"):
        open_recording(drive, odometry_topic="/wheels")


@pytest.mark.parametrize("kind", ["png", "jpg"])
def test_compressed_colour_is_grey(tmp_path, kind):
    colours = cv2.applyColorMap(cv2.GaussianBlur(SCENE, (0, 0), 3.0), cv2.COLORMAP_JET)
    path = write(
        tmp_path / "c.bag", [("/c/image_raw/compressed", compressed(1, colours, kind)), ("/c/camera_info", info())]
    )
    recording = open_recording(path)
    [frame] = recording.frames()
    expected = cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY).astype(int)
    assert np.abs(frame.image - expected).mean() <= (1.0 if kind == "png" else 4.0)
    assert recording.camera.fx == 30.0


@pytest.mark.parametrize("order", ["rggb", "grbg", "gbrg", "bggr"])
def test_mosaics_of_a_camera(tmp_path, order):
    place = ["rggb", "grbg", "gbrg", "bggr"].index(order)
    mosaic = np.zeros((24, 32), np.uint8)
    mosaic[place // 2 :: 2, place % 2 :: 2] = 200
    [frame] = open_recording(write(tmp_path / "b.bag", [("/i", image(1, mosaic, f"bayer_{order}8"))])).frames()
    assert np.abs(frame.image[4:-4, 4:-4].astype(float) - 0.299 * 200).max() <= 3


@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped"])
def test_poses_serve_as_odometry_when_asked_for(tmp_path, kind):
    def pose(stamp_ns, x):
        stamped = odometry(stamp_ns, x)
        held = stamped.pose.pose if kind == "PoseStamped" else stamped.pose
        return T[f"geometry_msgs/msg/{kind}"](header(stamp_ns), held)

    messages = [("/image", image(10**8)), *(("/robot_pose", pose(i * 10**8, 0.03 * i)) for i in range(4))]
    path = write(tmp_path / "p.bag", messages)
    assert open_recording(path).odometry == []
    readings = open_recording(path, odometry_topic="robot_pose").odometry
    assert [reading.T_odom_base.x for reading in readings] == pytest.approx([0.0, 0.03, 0.06, 0.09])
    assert [reading.v for reading in readings] == pytest.approx([0.0, 0.3, 0.3, 0.3], rel=1e-4)
    assert all(reading.omega == 0.0 for reading in readings)


def test_the_only_calibration_serves_images_elsewhere(tmp_path):
    messages = [("/c/image_raw", image(1)), ("/calibration", info()), ("/wheels/odometry_filtered", odometry(1, 0.0))]
    recording = open_recording(write(tmp_path / "e.bag", messages))
    assert recording.camera.fx == 30.0
    assert recording.odometry_topic == "/wheels/odometry_filtered"
    assert open_recording(write(tmp_path / "f.bag", [*messages, ("/other/camera_info", info())])).camera is None


def test_rectified_images_take_the_projection(tmp_path):
    camera = open_recording(write(tmp_path / "r.bag", [("/c/image_rect", image(1)), ("/c/camera_info", info())])).camera
    assert (camera.fx, camera.cx, camera.distortion) == (28.0, 15.0, (0.0, 0.0, 0.0, 0.0, 0.0))


def test_an_uncalibrated_camera_is_no_camera(tmp_path):
    path = write(tmp_path / "u.bag", [("/c/camera_info", info(fx=0.0)), ("/c/image_raw", image(1))])
    assert open_recording(path).camera is None


def test_a_fisheye_is_refused_by_name(tmp_path):
    path = write(tmp_path / "f.bag", [("/c/camera_info", info(model="equidistant")), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="'equidistant'"):
        open_recording(path)


def test_calibration_of_another_size_is_refused(tmp_path):
    path = write(tmp_path / "z.bag", [("/c/camera_info", info(width=64)), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="32x24 but the calibration is for 64x24"):
        list(open_recording(path).frames())


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
