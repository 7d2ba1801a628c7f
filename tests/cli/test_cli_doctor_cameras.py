"""The doctor's checks of cameras and calibrations, in an emulated sysfs."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from machine_files import CAMERA_INFO, of, usb, video_node, webcam

from vsx_hw import v4l
from vsx_ros.cli.check_devices import check_devices as devices
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN


def test_a_kinect_and_the_driver_that_takes_it(tmp_path: Path) -> None:
    usb(tmp_path, "1-1", "02ae", 2)
    assert [f.level for f in of("camera", list(devices(tmp_path, {}, False)))] == [OK]
    (tmp_path / "sys/module/gspca_kinect").mkdir(parents=True)
    found = of("camera", list(devices(tmp_path, {}, False)))
    assert [f.level for f in found] == [OK, WARN]
    assert "rmmod gspca_kinect" in found[1].remedy


def test_a_kinect_without_power_shows_its_motor_only(tmp_path: Path) -> None:
    usb(tmp_path, "1-1", "02b0", 2)
    (found,) = of("camera", list(devices(tmp_path, {}, False)))
    assert found.level == FAIL
    assert "12 V" in found.remedy


def test_a_webcam_is_told_with_the_name_of_its_calibration(tmp_path: Path) -> None:
    webcam(tmp_path)
    (found,) = of("camera", list(devices(tmp_path, {}, False)))
    assert found.level == OK
    named = "as --camera v4l:0, calibrated by rgb_045e_0825_A1B2.yaml"
    assert found.text == f"/dev/video0: UVC Camera, {named}, may be opened"


class Capture:
    """OpenCV's capture device; damaged: so many of its images cannot be read. size: width, height [px]."""

    def __init__(self, damaged: float, size: tuple[int, int] = (640, 480)) -> None:
        self.damaged, self.size, self.released = damaged, size, False

    def isOpened(self) -> bool:  # noqa: N802 (OpenCV's name)
        return True

    def set(self, name: int, value: float) -> bool:
        return False

    def get(self, name: int) -> float:
        sizes = {cv2.CAP_PROP_FRAME_WIDTH: self.size[0], cv2.CAP_PROP_FRAME_HEIGHT: self.size[1]}
        return float(sizes.get(name, 0))

    def read(self) -> object:
        self.damaged -= 1
        return (False, None) if self.damaged >= 0 else (True, np.zeros(self.size[::-1], np.uint8))

    def release(self) -> None:
        self.released = True


@pytest.mark.parametrize(("damaged", "level"), [(0, OK), (2, OK), (math.inf, FAIL)])
def test_with_hw_a_webcam_gives_an_image(
    damaged: float, level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    webcam(tmp_path)
    capture = Capture(damaged)
    monkeypatch.setattr(v4l, "open_video", lambda number: {0: capture}[number])
    found = of("camera", list(devices(tmp_path, {}, True)))
    assert [f.level for f in found] == [OK, level]
    assert "/dev/video0" in found[1].text
    assert ("640x480" in found[1].text) == (level == OK)
    assert bool(found[1].remedy) == (level == FAIL)
    assert capture.released


@pytest.mark.parametrize(("damaged", "level"), [(0, NOTE), (math.inf, FAIL)])
def test_with_hw_an_image_of_another_size_is_one(
    damaged: float, level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The camera of a laptop for faces, without VGA: the node camera takes it in another mode."""
    webcam(tmp_path)
    capture = Capture(damaged, (640, 360))
    monkeypatch.setattr(v4l.cv2, "VideoCapture", lambda number, _: {0: capture}[number])
    found = of("camera", list(devices(tmp_path, {}, True)))
    assert [f.level for f in found] == [OK, level]
    if level == NOTE:
        assert "/dev/video0 gives images of 640x360" in found[1].text
        assert "~mode" in found[1].remedy
    assert capture.released


@pytest.mark.parametrize("good", [0, 97])
def test_with_hw_one_camera_with_an_image_is_enough(good: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of a Raspberry Pi's own camera are listed as cameras, too."""
    webcam(tmp_path)
    video_node(tmp_path, 97)
    monkeypatch.setattr(v4l, "open_video", lambda number: Capture(0 if number == good else math.inf))
    found = of("camera", list(devices(tmp_path, {}, True)))[2:]
    assert {f.text.split()[0]: f.level for f in found} == {f"/dev/video{good}": OK, f"/dev/video{97 - good}": WARN}


def test_with_hw_a_webcam_that_does_not_open_is_a_failure(tmp_path: Path) -> None:
    """No kernel is behind this one, so that the driver cannot open it."""
    video_node(tmp_path, 97)
    found = of("camera", list(devices(tmp_path, {}, True)))
    assert [f.level for f in found] == [OK, FAIL]
    assert "/dev/video97 cannot be opened" in found[1].text
    assert "group video" in found[1].remedy


def test_with_hw_what_gives_no_images_is_no_camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the second device of a webcam, which gives metadata."""
    webcam(tmp_path)
    monkeypatch.setattr("vsx_ros.cli.check_devices.gives_images", lambda device: device != tmp_path / "dev/video0")
    (found,) = of("camera", list(devices(tmp_path, {}, True)))
    assert found.level == FAIL
    assert "neither" in found.text


def test_a_calibration_with_a_name_of_earlier_versions_is_not_called_good(tmp_path: Path) -> None:
    (tmp_path / "camera_info").mkdir()
    old, new = ("video0", "usb-1-7", "image_raw_compressed"), ("usb-1-port1.4", "046d_0825_A1B2", "image_raw")
    for name, level in [(name, WARN) for name in old] + [(name, OK) for name in new]:
        file = tmp_path / f"camera_info/rgb_{name}.yaml"
        file.write_text(CAMERA_INFO, encoding="utf-8")
        (found,) = of("calibration", list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, False)))
        assert (found.level, str(file) in found.text) == (level, True)
        file.unlink()


def test_calibrations_are_read_not_only_found(tmp_path: Path) -> None:
    folder = tmp_path / "camera_info"
    folder.mkdir()
    (folder / "rgb_A.yaml").write_text(CAMERA_INFO, encoding="utf-8")
    (folder / "rgb_B.yaml").write_text("image_width: many\n", encoding="utf-8")
    good, bad = of("calibration", list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, False)))
    assert (good.level, bad.level) == (OK, FAIL)
    assert "640x480, 525.0 px" in good.text
    assert "rgb_B.yaml" in bad.text
