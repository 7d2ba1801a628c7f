"""The doctor's checks of the machine and the base, and the whole command."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from free_ports import free_port
from machine_files import of
from waiting import PATIENCE_S

from vsx_hw.bases import base_emulator
from vsx_hw.errors import DeviceNotFound
from vsx_ros.cli import check_machine, main
from vsx_ros.cli.check_devices import check_devices as devices
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding, check_speed, judged

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


def test_an_empty_machine_is_a_note_and_with_hw_a_failure(tmp_path: Path) -> None:
    for speak, level in ((False, NOTE), (True, FAIL)):
        found = list(devices(tmp_path, {"ROS_HOME": str(tmp_path)}, speak))
        assert [f.level for f in of("base", found) + of("camera", found)] == [level, level]
        assert of("calibration", found)[0].level == WARN


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
