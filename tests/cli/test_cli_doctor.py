"""The doctor's checks against real things: a base on an emulated wire, a Kinect in an emulated sysfs."""

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import pytest
from free_ports import free_port
from waiting import PATIENCE_S

from vsx_hw import v4l
from vsx_hw.bases import base_emulator
from vsx_hw.errors import DeviceNotFound
from vsx_ros.cli import check_machine, main
from vsx_ros.cli.check_devices import check_devices as devices
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding, check_speed, judged

CHECKOUT = Path(__file__).resolve().parents[2]
NOBODY = 65534
CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: rgb
camera_matrix: {rows: 3, cols: 3, data: [525.0, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
KINECT = """P: /devices/pci0000:00/0000:00:14.0/usb1/1-1
N: bus/usb/001/002
E: DEVNAME=/dev/bus/usb/001/002
E: SUBSYSTEM=usb
A: busnum=1\\n
A: devnum=2\\n
A: idVendor=045e\\n
A: idProduct=02ae\\n
A: serial=A00367A00955107A\\n
"""


def of(area: str, findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.area == area]


# Devices -------------------------------------------------------------------------------------------------------


def usb(root: Path, place: str, product: str, node: int) -> None:
    entry = root / "sys/bus/usb/devices" / place
    entry.mkdir(parents=True)
    for name, content in (("idVendor", "045e"), ("idProduct", product), ("busnum", "1"), ("devnum", str(node))):
        (entry / name).write_text(f"{content}\n", encoding="utf-8")
    (root / "dev/bus/usb/001").mkdir(parents=True, exist_ok=True)
    (root / f"dev/bus/usb/001/{node:03d}").touch()


def test_an_empty_machine_is_a_note_and_with_hw_a_failure(tmp_path: Path) -> None:
    for speak, level in ((False, NOTE), (True, FAIL)):
        found = list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, speak))
        assert [f.level for f in of("base", found) + of("camera", found)] == [level, level]
        assert of("calibration", found)[0].level == WARN


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


def video_node(root: Path, number: int) -> None:
    """Another camera, not on the USB."""
    entry = root / f"sys/class/video4linux/video{number}"
    entry.mkdir(parents=True)
    (entry / "name").write_text("bcm2835-isp\n", encoding="utf-8")
    (root / "dev").mkdir(exist_ok=True)
    (root / f"dev/video{number}").touch()


def webcam(root: Path) -> Path:
    """Plug one in; its device file."""
    entry, device = root / "sys/class/video4linux/video0", root / "sys/bus/usb/devices/1-1"
    entry.mkdir(parents=True)
    (entry / "name").write_text("UVC Camera\n", encoding="utf-8")
    usb(root, "1-1", "0825", 2)
    (device / "serial").write_text("A1B2\n", encoding="utf-8")
    (device / "1-1:1.0").mkdir()
    (entry / "device").symlink_to(device / "1-1:1.0")
    (root / "dev/video0").touch()
    return root / "dev/video0"


def test_a_webcam_is_told_with_the_name_of_its_calibration(tmp_path: Path) -> None:
    webcam(tmp_path)
    (found,) = of("camera", list(devices(tmp_path, {}, False)))
    assert found.level == OK
    named = "as --camera v4l:0, calibrated by rgb_045e_0825_A1B2.yaml"
    assert found.text == f"/dev/video0: UVC Camera, {named}, may be opened"


def test_what_a_container_was_not_given_is_absent(tmp_path: Path) -> None:
    """It sees the host's /sys, and in /dev only what it was given."""
    webcam(tmp_path).unlink()
    usb(tmp_path, "1-2", "02ae", 3)
    (tmp_path / "dev/bus/usb/001/003").unlink()
    for speak, level in ((False, NOTE), (True, FAIL)):
        (found,) = of("camera", list(devices(tmp_path, {}, speak)))
        assert (found.level, "neither" in found.text) == (level, True)
        assert "container" in found.remedy


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


def test_with_hw_one_base_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A laser scanner may be at another serial port."""
    (tmp_path / "dev").mkdir()
    for name in ("ttyUSB0", "ttyUSB1"):
        (tmp_path / "dev" / name).touch()

    def detect(port: str) -> str:
        if port.endswith("1"):
            return "kobuki"
        raise DeviceNotFound(f"{port}: nothing answers; switch it on")

    monkeypatch.setattr("vsx_hw.bases.detect_base", detect)
    assert [f.level for f in of("base", list(devices(tmp_path, {}, True)))] == [OK, OK, WARN, OK]
    (tmp_path / "dev/ttyUSB1").unlink()
    assert [f.level for f in of("base", list(devices(tmp_path, {}, True)))] == [OK, FAIL]


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


def become_nobody() -> None:
    """Of root; anybody else has no privilege to drop."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def found_at(root: Path) -> list[Finding]:
    return list(devices(root, {}, False))


def test_missing_permissions_name_the_group() -> None:
    """pytest's own folder is closed to others, so another one; all modules are loaded before the child is born."""
    privileged = os.geteuid() == 0
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        root.chmod(0o755)
        usb(root, "1-1", "02ae", 2)
        port, camera = root / "dev/ttyUSB0", root / "dev/bus/usb/001/002"
        port.touch()
        before = found_at(root)
        port.chmod(0)
        camera.chmod(0)
        with ProcessPoolExecutor(1, get_context("fork"), become_nobody) as child:
            found = child.submit(found_at, root).result(timeout=PATIENCE_S)
            rules = root / "etc/udev/rules.d"
            rules.mkdir(parents=True)
            shutil.copy(CHECKOUT / "hw/udev/60-vsx.rules", rules)
            with_rule = child.submit(found_at, root).result(timeout=PATIENCE_S)
    assert [f.level for f in of("base", before) + of("camera", before)] == [OK, OK]
    assert [f.level for f in of("base", found) + of("camera", found)] == [FAIL, FAIL]
    assert "usermod -aG dialout" in of("base", found)[0].remedy
    assert "udevadm" in of("camera", found)[0].remedy
    assert "udev rule is not installed" in of("permissions", found)[0].text
    assert of("permissions", with_rule)[0].level == OK
    if privileged:  # whoever tests else may be in the groups
        assert [f.level for f in of("permissions", found)] == [WARN, WARN]
        assert "usermod -aG dialout,plugdev,video" in of("permissions", found)[1].remedy
        assert [f.level for f in of("permissions", before)] == [WARN]


@pytest.mark.parametrize("kinect", [False, True])
def test_a_webcam_without_permission_is_told_and_no_failure(kinect: bool) -> None:
    """It may be a laptop's own, and the robot's camera elsewhere."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        root.chmod(0o755)
        webcam(root).chmod(0)
        if kinect:
            usb(root, "1-2", "02ae", 3)
            (root / "dev/bus/usb/001/003").chmod(0o666)
        with ProcessPoolExecutor(1, get_context("fork"), become_nobody) as child:
            found = child.submit(found_at, root).result(timeout=PATIENCE_S)
    told = of("camera", found)[-1]
    assert told.level == WARN
    assert "/dev/video0: UVC Camera" in told.text
    assert "may not be opened" in told.text
    assert "usermod -aG video" in told.remedy
    if os.geteuid() == 0:
        assert "video (/dev/videoN)" in of("permissions", found)[-1].text


def test_calibrations_are_read_not_only_found(tmp_path: Path) -> None:
    folder = tmp_path / "camera_info"
    folder.mkdir()
    (folder / "rgb_A.yaml").write_text(CAMERA_INFO, encoding="utf-8")
    (folder / "rgb_B.yaml").write_text("image_width: many\n", encoding="utf-8")
    good, bad = of("calibration", list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, False)))
    assert (good.level, bad.level) == (OK, FAIL)
    assert "640x480, 525.0 px" in good.text
    assert "rgb_B.yaml" in bad.text


class Wheels:
    """A plant that stands."""

    speeds = (0.0, 0.0)

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        self.speeds = left_m_s, right_m_s

    def advance(self, dt_ns: int) -> None:
        pass

    def read(self) -> object:
        from vsx_hw.readings import Hazard
        from vsx_hw.serial_emulator import PlantState

        return PlantState(0.0, 0.0, 0.0, 0.0, Hazard.NONE)


def test_with_hw_the_base_says_who_it_is_and_no_wheel_turns(tmp_path: Path) -> None:
    (tmp_path / "dev").mkdir()
    plant = Wheels()
    with base_emulator("kobuki", plant, str(tmp_path / "dev/kobuki")):
        found = of("base", list(devices(tmp_path, {}, True)))
    assert [f.level for f in found] == [OK, OK]
    assert "is a kobuki" in found[1].text
    assert plant.speeds == (0.0, 0.0)


@pytest.mark.skipif(shutil.which("umockdev-run") is None, reason="needs umockdev: apt-get install umockdev")
def test_the_whole_command_on_a_machine_with_a_kinect(tmp_path: Path) -> None:
    (tmp_path / "kinect.umockdev").write_text(KINECT, encoding="utf-8")
    command = [sys.executable, "-m", "vsx_ros.cli.main", "doctor", "--quick", "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "ROS_HOME": str(tmp_path)}
    environment["ROS_MASTER_URI"] = f"http://localhost:{free_port()}"
    wrapped = ["umockdev-run", "--device", str(tmp_path / "kinect.umockdev"), "--", *command]
    done = subprocess.run(wrapped, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    findings = [Finding(**entry) for entry in json.loads(done.stdout)]
    assert done.returncode == int(any(f.level == FAIL for f in findings)), done.stderr
    assert "Kinect A00367A00955107A" in of("camera", findings)[0].text
    assert of("permissions", findings)


# Machine -------------------------------------------------------------------------------------------------------


def test_two_ros_installations_are_told(tmp_path: Path) -> None:
    (tmp_path / "opt/ros/noetic").mkdir(parents=True)
    (tmp_path / "usr/lib/python3/dist-packages/rospy").mkdir(parents=True)
    found = of("ros", list(check_machine.check_machine(tmp_path, tmp_path)))
    assert [f.level for f in found if "noetic" in f.text] == [WARN]


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for free, level in ((0.5e9, FAIL), (3e9, WARN), (50e9, OK)):
        usage = shutil._ntuple_diskusage(100e9, 0.0, free)  # type: ignore[attr-defined]  # its type is private
        monkeypatch.setattr(check_machine.shutil, "disk_usage", lambda _, usage=usage: usage)
        assert of("disk", list(check_machine.check_machine(tmp_path, tmp_path)))[0].level == level


def test_a_library_of_an_unknown_major_version_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = check_machine.metadata.version
    monkeypatch.setattr(check_machine.metadata, "version", lambda n: "5.0.0" if n.startswith("opencv") else real(n))
    found = of("libraries", list(check_machine.check_machine(tmp_path, tmp_path)))
    assert [f.level for f in found] == [FAIL, OK]
    assert "opencv-python-headless 5.0.0" in found[0].text


def test_the_speed_of_tracking_is_measured_and_judged() -> None:
    assert "ms per image" in check_speed().text
    assert [judged([ms] * 3, 0.0, 2).level for ms in (16.0, 20.0, 40.0)] == [OK, WARN, FAIL]
    assert "end them" in judged([40.0], 5.0, 2).remedy
    assert judged([], 0.0, 2).level == FAIL


def test_a_failure_is_exit_code_1(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://robot.invalid:11311")
    assert main.execute(["doctor", "--quick"]) == 1
    shown = capsys.readouterr().out
    assert "fail master" in shown
    assert "-> correct ROS_MASTER_URI" in shown


def test_the_robot_s_own_parameters_are_read(tmp_path: Path) -> None:
    folder = tmp_path / "vsx_ros"
    folder.mkdir()
    (folder / "robot.yaml").write_text("robot: {odometry: {linear_scale: 1.012}}\n", encoding="utf-8")
    [_, good] = of("calibration", list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, False)))
    assert good.level == OK
    assert "1.0120" in good.text
    (folder / "robot.yaml").write_text("robot: {wings: 2}\n", encoding="utf-8")
    [_, bad] = of("calibration", list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, False)))
    assert bad.level == FAIL
    assert "wings" in bad.text
