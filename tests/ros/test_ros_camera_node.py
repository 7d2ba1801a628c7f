"""The camera node's calibration, without a master."""

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy

from vsx_hw.errors import DeviceNotFound
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.readings import ImageReading
from vsx_ros.arrays import GrayImage
from vsx_ros.errors import CalibrationError, ConfigError
from vsx_ros.geometry.camera import KINECT_SHUTTER, PinholeCamera, Shutter
from vsx_ros.ros import cameras, headers, topic_camera
from vsx_ros.ros.cameras import CAMERAS, CameraCalibration, CameraEntry, nominal, open_camera
from vsx_ros.ros.topic_camera import TopicCamera

DEVICE = "ros:/cam/image_raw"
MEASURED = PinholeCamera(640, 480, 511.0, 512.0, 321.0, 243.0)
SHUTTERED = PinholeCamera(640, 480, 400.0, 400.0, 319.5, 239.5, shutter=Shutter(0.01, 0.005))


@pytest.mark.parametrize(("size", "focal", "centre"), [((640, 480), 525, 239.5), ((1280, 1024), 1050, 479.5)])
def test_an_uncalibrated_kinect_has_nominal_values_in_every_mode(
    size: tuple[int, int], focal: float, centre: float
) -> None:
    camera = nominal("kinect", *size)
    assert (camera.width, camera.height) == size
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (focal, focal, (size[0] - 1) / 2, centre)
    assert nominal("v4l:0", 1280, 1024).cy == 511.5


@pytest.mark.parametrize(
    ("device", "mode"),
    [("kinectt", "vga"), ("v4l:x", "vga"), ("v4l:", "vga"), ("emulator:", "vga"), ("kinect", "4k"), ("ros:", "vga")],
)
def test_a_device_or_mode_without_meaning_is_refused(device: str, mode: str) -> None:
    with pytest.raises(ConfigError, match="give"):
        open_camera(device, lambda reading: None, mode)


def test_a_kinect_is_found_again_behind_another_one_on_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(serial: str) -> SimpleNamespace:
        for each in bus:
            if serial in ("", each):
                return SimpleNamespace(serial=each, close=lambda: None)
        raise DeviceNotFound(f"no Kinect with serial number {serial}; found {bus}")

    monkeypatch.setattr(cameras, "UsbTransport", found)
    bus, camera = ["A", "B"], open_camera("kinect", lambda reading: None)
    assert isinstance(camera, KinectCamera)
    assert camera._open().serial == "A"
    bus[:] = ["B"]
    with pytest.raises(DeviceNotFound, match="kinect is B now; plug A in as before"):
        camera._open()
    bus[:] = ["B", "A"]
    assert camera._open().serial == "A"
    bus[:] = ["usb-1-port2"]
    assert camera._open().serial == "usb-1-port2", "its audio part is out of reach"


@pytest.mark.parametrize("name", ["folder", "kinect2", "rosbag", "v4l2", "emulators"])
def test_a_plug_in_camera_is_what_its_entry_says_whatever_its_name_begins_with(
    name: str, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    monkeypatch.setitem(CAMERAS, name, CameraEntry(lambda _: SimpleNamespace()))
    source = SimpleNamespace(calibration=None, serial="nobody_has_this_one")
    seen = CameraCalibration(f"{name}:x", "").of(source, 1280, 720)
    assert (seen.cx, seen.cy, seen.shutter) == (639.5, 359.5, None)
    monkeypatch.setitem(CAMERAS, name, CameraEntry(lambda _: SimpleNamespace(), lambda *_: SHUTTERED))
    assert CameraCalibration(f"{name}:x", "").of(source, 640, 480) == SHUTTERED
    source.calibration = MEASURED
    assert CameraCalibration(f"{name}:x", "").of(source, 640, 480) == replace(MEASURED, shutter=SHUTTERED.shutter)
    assert warned


def test_a_kinect_has_its_shutter_also_with_a_calibration_that_does_not_know_it() -> None:
    source = SimpleNamespace(calibration=MEASURED, serial="nobody_has_this_one")
    for device, shutter in (("kinect", KINECT_SHUTTER), ("kinect:A0", KINECT_SHUTTER), ("v4l:0", None)):
        assert CameraCalibration(device, "").of(source, 640, 480) == replace(MEASURED, shutter=shutter)


def test_a_calibration_that_comes_after_the_first_image_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
    source = SimpleNamespace(calibration=None, serial="nobody_has_this_one")
    calibration = CameraCalibration(DEVICE, "")
    assert calibration.of(source, 640, 480) == nominal(DEVICE, 640, 480)
    assert not calibration.known
    source.calibration = MEASURED
    assert calibration.of(source, 640, 480) == MEASURED
    assert calibration.known


@pytest.fixture
def warned(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    said: list[str] = []
    monkeypatch.setattr(rospy, "logwarn", lambda form, *values: said.append(form % values))
    return said


def test_a_calibration_of_another_size_is_told_once_and_again_after_a_change(warned: list[str]) -> None:
    source = SimpleNamespace(calibration=replace(MEASURED, width=1280, height=720), serial="nobody_has_this_one")
    calibration = CameraCalibration(DEVICE, "")
    for expected in (1, 2):
        for _ in range(5):
            assert calibration.of(source, 640, 480) == nominal(DEVICE, 640, 480)
        assert not calibration.known
        assert len([text for text in warned if text.endswith("is of 1280x720, images are 640x480")]) == expected
        source.calibration = replace(source.calibration, fx=900.0)


def test_the_newest_calibration_of_a_driver_is_used() -> None:
    source = SimpleNamespace(calibration=MEASURED, serial="nobody_has_this_one")
    calibration = CameraCalibration(DEVICE, "")
    for focal_px in (511.0, 530.0):
        source.calibration = replace(MEASURED, fx=focal_px)
        assert calibration.of(source, 640, 480).fx == focal_px
    assert calibration.known


def test_the_users_own_calibration_comes_before_that_of_the_driver_also_after_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    """The user made it on purpose, for instance because the driver's is nominal."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    source = SimpleNamespace(calibration=MEASURED, serial="cam")
    own = replace(MEASURED, fx=520.0)
    first = CameraCalibration(DEVICE, "")
    assert first.of(source, 640, 480) == MEASURED
    stored = first.store(source, own)
    assert first.of(source, 640, 480).fx == 520.0
    assert CameraCalibration(DEVICE, str(stored)).of(source, 640, 480).fx == 520.0
    later = CameraCalibration(DEVICE, "")
    assert [later.of(source, 640, 480).fx for _ in range(3)] == [520.0] * 3
    source.calibration = replace(MEASURED, width=1280, height=720)
    assert later.of(source, 640, 480).fx == 520.0
    assert later.known
    assert warned == []


def test_a_stored_calibration_far_from_that_of_the_driver_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    source = SimpleNamespace(calibration=replace(MEASURED, fx=610.0), serial="cam")
    stored, later = CameraCalibration(DEVICE, "").store(source, MEASURED), CameraCalibration(DEVICE, "")
    assert [later.of(source, 640, 480).fx for _ in range(3)] == [MEASURED.fx] * 3
    assert len(warned) == 1
    assert f"{stored} is used (fx fy cx cy: 511 512 321 243 px); its driver says 610 512 321 243" in warned[0]


@pytest.mark.parametrize("damaged", [False, True])
def test_a_stored_calibration_that_does_not_fit_leaves_the_driver_its_own(
    damaged: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    source = SimpleNamespace(calibration=MEASURED, serial="cam")
    stored = CameraCalibration(DEVICE, "").store(source, replace(MEASURED, width=1280, height=720))
    if damaged:
        stored.write_text("image_width: 640\n", encoding="utf-8")
    later = CameraCalibration(DEVICE, "")
    assert [later.of(source, 640, 480) for _ in range(3)] == [MEASURED] * 3
    assert later.known
    assert len(warned) == 1
    assert ("the stored calibration is not used" if damaged else "is of 1280x720, images are 640x480") in warned[0]


def test_a_calibration_counts_also_for_the_compressed_images_of_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    source = TopicCamera("/cam/image_raw", lambda _: None)
    CameraCalibration(DEVICE, "").store(source, MEASURED)
    packed = TopicCamera("/cam/image_raw/compressed", lambda _: None)
    assert CameraCalibration(f"{DEVICE}/compressed", "").of(packed, 640, 480) == MEASURED


def test_rectified_images_are_as_their_driver_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    """P is exact there, and the driver may rectify in another way tomorrow."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    device, source = "ros:/cam/image_rect_color", TopicCamera("/cam/image_rect_color", lambda _: None)
    CameraCalibration(device, "").store(source, replace(MEASURED, fx=540.0))
    later = CameraCalibration(device, "")
    assert later.of(source, 640, 480).fx == 540.0, "nothing better is known"
    source.calibration = MEASURED
    assert later.of(source, 640, 480) == MEASURED
    with pytest.raises(CalibrationError, match="calibrate the topic of its raw images"):
        later.store(source, replace(MEASURED, fx=540.0))
    chosen = CameraCalibration(device, str(tmp_path / "camera_info/rgb_cam_image_rect_color.yaml"))
    assert chosen.of(source, 640, 480).fx == 540.0
    assert warned == []


@pytest.mark.parametrize(
    ("device", "serial", "old"),
    [
        ("v4l:0", "046d_0825_A1B2", "video0"),
        ("kinect", "usb-1-port1.4", "usb-1-7"),
        (f"{DEVICE}/compressed", "cam_image_raw", "cam_image_raw_compressed"),
    ],
)
def test_a_calibration_with_a_name_of_earlier_versions_is_not_used_but_told(
    device: str, serial: str, old: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    """Another camera may have had that number."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    camera = SimpleNamespace(serial=old)
    before = CameraCalibration(device, "").store(camera, MEASURED)
    camera.serial = serial
    calibration = CameraCalibration(device, "")
    for _ in range(3):
        assert calibration.of(camera, 640, 480) == nominal(device, 640, 480)
    assert not calibration.known
    wanted = tmp_path / f"camera_info/rgb_{serial}.yaml"
    assert len(warned) == 2
    assert f"'mv {before} {wanted}'" in warned[0]
    before.rename(wanted)
    moved = CameraCalibration(device, "")
    assert moved.of(camera, 640, 480).fx == MEASURED.fx
    assert moved.known
    assert len(warned) == 2


def test_a_calibration_with_a_name_of_earlier_versions_is_told_also_where_the_driver_has_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warned: list[str]
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    device, own = f"{DEVICE}/compressed", replace(MEASURED, fx=520.0)
    before = CameraCalibration(device, "").store(SimpleNamespace(serial="cam_image_raw_compressed"), own)
    source = TopicCamera("/cam/image_raw/compressed", lambda _: None)
    source.calibration = MEASURED
    calibration = CameraCalibration(device, "")
    assert [calibration.of(source, 640, 480) for _ in range(3)] == [MEASURED] * 3
    assert len(warned) == 1
    assert f"'mv {before} {tmp_path / 'camera_info/rgb_cam_image_raw.yaml'}'" in warned[0]


def test_a_calibration_in_the_usual_folder_of_ros_needs_no_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    source = SimpleNamespace(serial="cam")
    stored = CameraCalibration(DEVICE, "").store(source, MEASURED)
    assert stored == tmp_path / ".ros/camera_info/rgb_cam.yaml"
    for name in ("${ROS_HOME}", "$ROS_HOME"):
        calibration = CameraCalibration(DEVICE, f"file://{name}/camera_info/rgb_cam.yaml")
        assert calibration.known
        assert calibration.store(source, replace(MEASURED, fx=520.0)) == stored


def test_no_calibration_is_stored_for_a_camera_that_is_not_known_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    for device in ("v4l:0", "v4l:/dev/v4l/by-id/usb-046d_0825_A1B2-video-index0", "kinect"):
        source = open_camera(device, lambda reading: None)
        with pytest.raises(CalibrationError, match="was not opened yet"):
            CameraCalibration(device, "").store(source, MEASURED)
    assert not list(tmp_path.iterdir())


class TopicRig:
    """A TopicCamera without a master, on clocks of its own; ROS time is 1000 s more. seen: what it passed on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.seen = 50.0, list[ImageReading]()
        self._next = (0, np.zeros((48, 64), np.uint8))
        monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
        monkeypatch.setattr(headers, "now_ns", lambda: round(1e9 * (1000.0 + self.now_s)))
        monkeypatch.setattr(topic_camera, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        monkeypatch.setattr(topic_camera, "image_of", lambda *_: self._next)
        self.camera = TopicCamera("/cam/image_raw", self.seen.append)
        self.camera.calibration = MEASURED

    def send(self, image: GrayImage, age_s: float = 0.0) -> str:
        """An image whose stamp is age_s old, 0.1 s after the last; returns what the status says."""
        self.now_s += 0.1
        self._next = (round(1e9 * (1000.0 + self.now_s - age_s)), image)
        self.camera._on_any(SimpleNamespace(_connection_header={"type": "sensor_msgs/Image"}, _buff=b""))
        return self.camera.status().message


def test_a_simulated_camera_without_noise_is_used_while_the_robot_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Withheld, they would keep the robot standing, and so equal for ever; ``vslam`` ends a drive on equal images."""
    rig, image = TopicRig(monkeypatch), np.full((48, 64), 7, np.uint8)
    told = [rig.send(image) for _ in range(30)]
    assert (len(rig.seen), told[0]) == (30, "streaming")
    assert "shows the same picture again and again" in told[-1]
    assert not rig.camera.status().connected
    assert rig.camera.status().counters["frozen_frames"] == 25
    assert rig.send(image + 1) == "streaming"


@pytest.mark.parametrize("age_s", [600.0, 1.5])
def test_images_with_old_stamps_are_told(age_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = TopicRig(monkeypatch)
    told = [rig.send(np.full((48, 64), k, np.uint8), age_s) for k in range(3)]
    assert len(rig.seen) == 3
    assert f"stamps are {age_s:.1f} s behind this machine's clock" in told[-1]
    assert rig.send(np.full((48, 64), 9, np.uint8), 0.5) == "streaming"


def test_images_whose_stamps_stand_are_no_images(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some drivers never set the stamp; others publish an image twice."""
    rig = TopicRig(monkeypatch)
    told = [rig.send(np.full((48, 64), k, np.uint8), 1000.0 + rig.now_s + 0.1) for k in range(20)]
    assert [reading.stamp_ns for reading in rig.seen] == [0]
    assert "no image with a new stamp comes on /cam/image_raw" in told[-1]
    assert rig.camera.status().counters == {"frames": 1, "repeated": 19, "frozen_frames": 0}


def test_the_first_images_of_a_driver_wait_for_their_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, seen, rng = [50.0], list[ImageReading](), np.random.default_rng(0)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    stamps_ns = itertools.count(1)
    monkeypatch.setattr(headers, "now_ns", lambda: 100)
    monkeypatch.setattr(topic_camera, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(
        topic_camera, "image_of", lambda *_: (next(stamps_ns), rng.integers(0, 256, (48, 64)).astype(np.uint8))
    )
    msg = SimpleNamespace(_connection_header={"type": "sensor_msgs/Image"}, _buff=b"")
    quick, never = (TopicCamera("/cam/image_raw", seen.append) for _ in range(2))
    quick._on_any(msg)
    assert seen == []
    quick.calibration = MEASURED
    quick._on_any(msg)
    assert len(seen) == 1
    for now_s[0] in (60.0, 60.5, 61.1):
        never._on_any(msg)
    assert len(seen) == 2, "without any it goes on after a second"
