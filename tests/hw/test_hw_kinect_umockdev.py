"""The Kinect driver above the real libusb, whose device answers ioctls (control and isochronous transfers)."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

pytest.importorskip("gi", reason="needs python3-gi")
WRAPPER = shutil.which("umockdev-wrapper")
pytestmark = pytest.mark.skipif(
    WRAPPER is None, reason="needs umockdev: apt-get install umockdev gir1.2-umockdev-1.0 python3-gi"
)


def run(frames: int, paced: bool = False, unplug_after: int = 0, lose: int = 0, back: bool = False) -> dict:
    child = Path(__file__).with_name("umockdev_kinect.py")
    arguments = [str(int(argument)) for argument in (frames, paced, unplug_after, lose, back)]
    command = [str(WRAPPER), sys.executable, str(child), *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_frames_come_through_libusb_byte_for_byte():
    result = run(90, paced=True)
    assert (result["good"], result["delivered"], result["torn_frames"]) == (90, 90, 0)
    assert result["serial"] == "A00367A00955107A"
    assert result["switched_off"]
    assert result["handed_back"], "to the kernel's driver"


def test_lost_packets_are_torn_frames_and_never_images():
    result = run(12, lose=1000)
    assert result["good"] == result["delivered"] == 12
    assert 1 <= result["torn_frames"] <= 5


def test_a_camera_unplugged_at_the_usb_is_told_so():
    result = run(100, unplug_after=8)
    assert "unplugged" in result["message"]
    assert 5 <= result["good"] == result["delivered"] <= 8


def test_a_camera_plugged_in_again_streams_by_itself():
    result = run(30, unplug_after=8, back=True)
    assert "no Kinect on the USB" in result["absent"]
    assert result["good"] == result["delivered"] == 30
    assert result["connections"] == 2
    assert result["message"] == "streaming"
    assert result["switched_off"]
