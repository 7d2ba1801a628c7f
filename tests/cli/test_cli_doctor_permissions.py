"""What the doctor says to somebody who may not open a device."""

import os
import shutil
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from machine_files import of, usb, webcam
from waiting import PATIENCE_S

from vsx_ros.cli.check_devices import check_devices as devices
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding

CHECKOUT = Path(__file__).resolve().parents[2]
NOBODY = 65534


def test_what_a_container_was_not_given_is_absent(tmp_path: Path) -> None:
    """It sees the host's /sys, and in /dev only what it was given."""
    webcam(tmp_path).unlink()
    usb(tmp_path, "1-2", "02ae", 3)
    (tmp_path / "dev/bus/usb/001/003").unlink()
    for speak, level in ((False, NOTE), (True, FAIL)):
        (found,) = of("camera", list(devices(tmp_path, {}, speak)))
        assert (found.level, "neither" in found.text) == (level, True)
        assert "container" in found.remedy


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
