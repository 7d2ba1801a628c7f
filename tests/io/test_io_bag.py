"""What is found in a bag, by type and by name."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from ros1_bags import SCENE, T, compressed, header, image, info, numbers, odometry, write, write_drive
from rosbags.rosbag1 import Writer

from vsx_ros.config import OdometryConfig
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording


@pytest.fixture
def drive(tmp_path):
    return write_drive(tmp_path / "drive.bag")


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


def test_odometry_is_interpolated_within_carried_on_and_absent_far_outside(drive):
    recording = open_recording(drive)
    assert recording.odometry_at(5 * 10**7).T_odom_base.x == pytest.approx(0.01, abs=1e-6)
    assert recording.odometry_at(6 * 10**8).T_odom_base.x == pytest.approx(0.12, abs=1e-5)
    assert recording.odometry_at(6 * 10**8 + 1) is None
    assert recording.odometry_at(-1) is None


def test_odometry_that_its_driver_does_not_trust_is_not_trusted(tmp_path):
    messages = [("/odom", odometry(k * 10**8, 0.0, variance)) for k, variance in enumerate((0.01, 1.0, 1e3))]
    messages += [("/camera/rgb/image_raw", image(10**8))]
    readings = open_recording(write(tmp_path / "doubt.bag", messages)).odometry
    assert [reading.trusted for reading in readings] == [True, False, False]


@pytest.mark.parametrize("compression", [Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_compressed_bags_and_images(tmp_path, compression):
    messages = [("/c/image/compressed", compressed(i * 10**7 + 1)) for i in range(3)]
    frames = list(open_recording(write(tmp_path / "c.bag", messages, compression)).frames())
    assert len(frames) == 3
    assert np.array_equal(frames[2].image, SCENE)


def read(path) -> tuple[list[int], list[str]]:
    """The stamps of a recording's images, and what it tells."""
    said: list[str] = []
    frames = [f.stamp_ns for f in replace(open_recording(path), tell=said.append).frames()]
    return frames, said


def test_images_that_are_swapped_are_sorted_and_a_doubled_one_is_told(tmp_path):
    stamps = [10, 30, 20, 30, 40]
    frames, said = read(write(tmp_path / "o.bag", [("/image", image(s)) for s in stamps]))
    assert frames == [10, 20, 30, 40]
    assert [text.partition(": ")[2] for text in said] == [
        "1 of 5 images left out: their stamps are those of others or out of order"
    ]
    assert read(write(tmp_path / "good.bag", [("/image", image(s)) for s in (10, 30, 20)])) == ([10, 20, 30], [])


def test_images_that_come_too_late_are_counted(tmp_path):
    stamps = [*range(10, 30), 5, 6, *range(30, 40)]
    frames, said = read(write(tmp_path / "l.bag", [("/image", image(s)) for s in stamps]))
    assert frames == list(range(10, 40))
    assert "2 of 32 images left out" in said[0]


def test_one_image_from_the_past_costs_no_other(tmp_path):
    stamps = [10**12 + k * 10**8 for k in range(12)]
    for wrong in (1, 3, 8):
        messages = [("/image", image(s - 10**11 * (k == wrong))) for k, s in enumerate(stamps)]
        frames, said = read(write(tmp_path / f"{wrong}.bag", messages))
        assert frames == [s for k, s in enumerate(stamps) if k != wrong]
        assert "1 of 12 images left out" in said[0]


def test_a_stamp_of_zero_among_good_ones_is_the_time_of_recording_without_the_delay(tmp_path):
    frames, said = read(write(tmp_path / "z.bag", [("/i", image(s)) for s in (900, 901, 0, 903)]))
    assert (frames, said) == ([900, 901, 902, 903], [])


def test_odometry_is_sorted_and_what_is_left_out_told(tmp_path):
    stamps = [10**12 + k * 10**8 for k in (0, 2, 1, 3, 3, 4)]
    messages = [("/odom", odometry(s, 0.0)) for s in (*stamps[:3], 10**15, *stamps[3:])]
    recording = open_recording(write(tmp_path / "d.bag", [*messages, ("/image", image(10**12))]))
    assert [reading.stamp_ns for reading in recording.odometry] == sorted(set(stamps))
    assert recording.damage == "2 readings of /odom left out: their stamps are those of others or out of order"


def test_speeds_from_poses_are_those_of_the_order_of_stamps(tmp_path):
    def pose(stamp_ns, x):
        at = odometry(stamp_ns, x).pose.pose
        return T["geometry_msgs/msg/PoseStamped"](header(stamp_ns), at)

    messages = [("/pose", pose(10**9 + k * 10**8, 0.02 * k)) for k in (0, 2, 1, 3)]
    path = write(tmp_path / "p.bag", [*messages, ("/image", image(10**9))])
    readings = open_recording(path, odometry_topic="/pose").odometry
    assert [reading.v for reading in readings[1:]] == pytest.approx([0.2] * 3)


def test_odometry_whose_driver_tells_no_speeds_has_those_of_its_poses(tmp_path):
    readings = [odometry(10**9 + k * 10**8, 0.02 * k) for k in range(4)]
    for reading in readings:
        reading.twist.twist.linear.x = reading.twist.twist.angular.z = 0.0
    messages = [("/odom", reading) for reading in readings]
    path = write(tmp_path / "n.bag", [*messages, ("/image", image(10**9))])
    assert [reading.v for reading in open_recording(path).odometry] == pytest.approx([0.0, 0.2, 0.2, 0.2])


def test_odometry_is_not_looked_at_if_none_is_wanted(tmp_path):
    messages = [("/a/odom", odometry(1, 0.0)), ("/b/odom", odometry(1, np.nan)), ("/image", image(1))]
    path = write(tmp_path / "n.bag", messages)
    with pytest.raises(InputError, match="several odometry topics; choose one with --odometry-topic, or none: /a/odom"):
        open_recording(path)
    recording = open_recording(path, odometry_topic="none")
    assert (recording.odometry, recording.odometry_topic, recording.damage) == ([], None, "")
    assert len(list(recording.frames())) == 1


@pytest.mark.parametrize(
    ("offset_s", "used"), [(0, True), (2.65, True), (2.95, False), (-3.15, False), (-1.5e9, False)]
)
def test_odometry_of_another_clock_is_not_used_and_the_clocks_are_told(tmp_path, offset_s, used):
    stamps = [1_600_000_000 * 10**9 + k * 10**8 for k in range(30)]
    messages = [("/image", image(s)) for s in stamps]
    messages += [("/odom", odometry(s + round(1e9 * offset_s), 0.01 * k)) for k, s in enumerate(stamps)]
    recording = open_recording(write(tmp_path / "k.bag", messages))
    assert bool(recording.odometry) is bool(recording.odometry_topic) is used
    told = "odometry of /odom is not used, as 0 of 30 images have any: its stamps are from"
    assert recording.damage.startswith(told) if not used else recording.damage == ""


def test_odometry_too_far_away_is_not_used(tmp_path):
    messages = [m for k in range(1, 9) for m in (("/image", image(k)), ("/odom", odometry(k, 5e5)))]
    recording = open_recording(write(tmp_path / "u.bag", messages))
    assert recording.odometry == []
    assert "0 of 8 images have any: odometry at (500000, 0) m" in recording.damage


def test_odometry_of_a_camera_in_the_hand_is_not_that_of_wheels(tmp_path):
    messages = [("/image", image(k * 10**8 + 1)) for k in range(20)]
    for k in range(20):
        reading = odometry(k * 10**8 + 1, 0.01 * k)
        reading.pose.pose.orientation.x, reading.pose.pose.orientation.w = math.sin(0.2), math.cos(0.2)
        messages.append(("/vio/odom", reading))
    recording = open_recording(write(tmp_path / "h.bag", messages))
    assert (recording.odometry, recording.odometry_topic) == ([], None)
    told = (
        "odometry of /vio/odom is not used: 20 of 20 poses are none of wheels on a floor (up to 23 deg of tilt, 0.0 m"
    )
    assert recording.damage.startswith(told)


def test_odometry_at_a_tenth_of_the_images_is_enough(tmp_path):
    messages = [("/image", image(k * 10**8 + 1)) for k in range(50)]
    messages += [("/odom", odometry(k * 10**8 + 1, 0.0)) for k in range(45, 50)]
    assert len(open_recording(write(tmp_path / "late.bag", messages)).odometry) == 5
    gone = [("/odom", odometry(k * 10**8 + 1, 0.0)) for k in range(48, 60)]
    assert (
        open_recording(write(tmp_path / "few.bag", messages[:50] + gone)).damage.count("2 of 50 images have any") == 1
    )


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


def chosen_of(path, **encodings):
    """The image topic that is found among those of the encodings, / for __ in their names."""
    pixels = {"16UC1": SCENE.astype("<u2"), "32FC1": SCENE.astype("<f4")}
    messages = [
        (name.replace("__", "/"), image(1, pixels.get(encoding, SCENE), encoding))
        for name, encoding in encodings.items()
    ]
    return open_recording(write(path, messages)).image_topic


@pytest.mark.parametrize(
    "topic", ["__r200_depth__image_raw", "__depth_camera__rgb__image_raw", "__disparity_rig__left"]
)
def test_a_camera_with_depth_in_its_name_is_one(tmp_path, topic):
    assert chosen_of(tmp_path / "a.bag", **{topic: "mono8"}) == topic.replace("__", "/")
    both = {topic: "mono8", "__r200_depth__depth__image_raw": "32FC1", "__r200_depth__depth__sw__image": "16UC1"}
    assert chosen_of(tmp_path / "b.bag", **both) == topic.replace("__", "/")


def test_depth_is_chosen_only_where_it_may_be_a_camera(tmp_path):
    assert chosen_of(tmp_path / "a.bag", __c__rgb__image="mono8", __c__depth__image="mono8") == "/c/rgb/image"
    with pytest.raises(InputError, match=r"choose one with --image-topic: /a_depth/i, /b_depth/i"):
        chosen_of(tmp_path / "b.bag", __a_depth__i="mono8", __b_depth__i="mono8")
    with pytest.raises(InputError, match=r"choose one with --image-topic: /depth_camera/rgb/i, /usb/i"):
        chosen_of(tmp_path / "c.bag", __depth_camera__rgb__i="mono8", __usb__i="mono8")
    with pytest.raises(InputError, match=r"no image topic; it has /c/depth/i \(.*can be chosen with --image-topic"):
        chosen_of(tmp_path / "d.bag", __c__depth__i="16UC1")


def test_a_topic_that_is_not_there_is_named(drive):
    with pytest.raises(InputError, match="no image topic /cam0; it has"):
        open_recording(drive, image_topic="/cam0")
    with pytest.raises(InputError, match="no odometry topic /wheels; it has"):
        open_recording(drive, odometry_topic="/wheels")


def test_a_topic_of_another_kind_is_told(tmp_path, drive):
    with pytest.raises(InputError, match=r"no image topic odom \(that is 5 messages of nav_msgs/msg/Odometry\);"):
        open_recording(drive, image_topic="odom")
    depth = compressed(1)
    depth.format = "16UC1; compressedDepth png"
    path = write(tmp_path / "d.bag", [("/depth/image/compressedDepth", depth)])
    with pytest.raises(InputError, match="has no image topic; it has /depth/image/compressedDepth"):
        open_recording(path)
    recording = open_recording(path, image_topic="/depth/image/compressedDepth")
    with pytest.raises(InputError, match="none can be used.*it is a depth image; choose the camera's topic"):
        list(recording.frames())


def test_a_calibration_that_comes_after_images_is_found(tmp_path):
    path = write(tmp_path / "l.bag", [*(("/c/image_raw", image(k)) for k in range(1, 5)), ("/c/camera_info", info())])
    assert open_recording(path).camera.fx == 30.0
    assert len(list(open_recording(path).frames())) == 4


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
    assert recording.damage.startswith("the calibration is that of /calibration, the only one of the bag, which does")
    assert recording.odometry_topic == "/wheels/odometry_filtered"
    assert open_recording(write(tmp_path / "f.bag", [*messages, ("/other/camera_info", info())])).camera is None


@pytest.mark.parametrize("name", ["image_rect", "image_rect_color", "image_rect_raw", "rectified", "image_rectified"])
def test_rectified_images_take_the_projection(tmp_path, name):
    messages = [(f"/c/{name}", image(1)), ("/c/camera_info", info())]
    camera = open_recording(write(tmp_path / "r.bag", messages)).camera
    assert (camera.fx, camera.cx, camera.distortion) == (28.0, 15.0, (0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("name", ["image_raw", "image_color_corrected", "image_unrectified", "direct"])
def test_other_images_take_the_lens(tmp_path, name):
    messages = [(f"/c_rect/{name}", image(1)), ("/c_rect/camera_info", info())]
    camera = open_recording(write(tmp_path / "r.bag", messages)).camera
    assert (camera.fx, camera.cx, camera.distortion) == (30.0, 15.5, (0.1, 0.0, 0.0, 0.0, 0.0))


def test_an_uncalibrated_camera_is_no_camera(tmp_path):
    path = write(tmp_path / "u.bag", [("/c/camera_info", info(fx=0.0)), ("/c/image_raw", image(1))])
    assert open_recording(path).camera is None


def test_an_unknown_lens_is_refused_by_name(tmp_path):
    path = write(tmp_path / "f.bag", [("/c/camera_info", info(model="omni")), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="'omni'"):
        open_recording(path)


@pytest.mark.parametrize("wrong", [info(model="thin_prism"), info(width=0), info(D=(np.nan,) * 5)])
def test_a_calibration_that_cannot_be_used_is_not_looked_at_where_another_is_given(tmp_path, wrong):
    path = write(tmp_path / "f.bag", [("/c/camera_info", wrong), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="^topic /c/camera_info: .*, or give another with --calibration FILE$"):
        open_recording(path)
    recording = open_recording(path, own_camera=False)
    assert (recording.camera, recording.damage) == (None, "")
    assert len(list(recording.frames())) == 1


def test_calibration_of_another_size_is_refused(tmp_path):
    path = write(tmp_path / "z.bag", [("/c/camera_info", info(width=64)), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="32x24 but the calibration is for 64x24"):
        list(open_recording(path).frames())


def told_shutter(times):
    return "/camera/rgb/shutter", numbers(times)


@pytest.mark.parametrize(("times", "shutter"), [([0.026, 0.015], (0.026, 0.015)), ([], None)])
def test_the_shutter_that_the_camera_told_is_the_recordings(tmp_path, times, shutter):
    path = write(tmp_path / "a.bag", [("/camera/rgb/camera_info", info()), told_shutter(times),
                                      ("/camera/rgb/image_raw", image(1))])  # fmt: skip
    known = open_recording(path).camera.shutter
    assert known == (None if shutter is None else pytest.approx(shutter))


@pytest.mark.parametrize("times", [[0.026], [0.026, -0.1], [np.nan, 0.01], [1.0, 2.0, 3.0], [0.6, 0.015]])
def test_a_shutter_that_cannot_be_is_one_sentence(tmp_path, times):
    path = write(tmp_path / "a.bag", [("/camera/rgb/camera_info", info()), told_shutter(times),
                                      ("/camera/rgb/image_raw", image(1))])  # fmt: skip
    with pytest.raises(CalibrationError, match="readout and exposure in seconds"):
        _ = open_recording(path)


@pytest.mark.parametrize("space", ["", "/robot"])
def test_the_factors_that_the_base_told_are_the_recordings_each_once(tmp_path, space):
    """A node that starts again tells them again; those of another robot are of no interest."""
    told = [(f"{space}/mobile_base/odometry_factors", numbers(factors)) for factors in ((0.974, 1.02),) * 2]
    other = [("/other/mobile_base/odometry_factors", numbers((0.9, 0.9)))]
    drive = [(f"{space}/odom", odometry(10**8, 0.0)), ("/camera/rgb/image_raw", image(10**8))]
    recording = open_recording(write(tmp_path / "a.bag", told + other + drive))
    assert recording.factors == (OdometryConfig(0.974, 1.02),)
    assert open_recording(write(tmp_path / "b.bag", other + drive)).factors == ()
    assert open_recording(tmp_path / "a.bag", None, "none").factors == ()


@pytest.mark.parametrize("factors", [[], [1.0], [1.0, 0.0], [1.0, np.nan], [1.0, 1.0, 1.0]])
def test_factors_that_cannot_be_are_one_sentence(tmp_path, factors):
    path = write(tmp_path / "a.bag", [("/mobile_base/odometry_factors", numbers(factors)),
                                      ("/odom", odometry(1, 0.0)), ("/image", image(1))])  # fmt: skip
    with pytest.raises(InputError, match="the factors of distance and turn"):
        _ = open_recording(path)
