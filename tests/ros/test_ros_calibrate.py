"""``vsx calibrate camera --live`` beside the real camera node, whose emulated Kinect looks at a board."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import numpy as np
import rosgraph
from board_pictures import Photographer, pose, poses
from ros_ports import HOST, free_port
from waiting import PATIENCE_S, wait_for

from vsx_hw.kinect.emulator import KinectEmulator
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.io.calibration_file import read_calibration

pytestmark = [pytest.mark.ros, pytest.mark.light]

CHECKOUT = Path(__file__).resolve().parents[2]
CAMERA = PinholeCamera(640, 480, 530.0, 532.0, 322.0, 251.0, (0.1, -0.2, 0.001, 0.0, 0.0))
PERIOD_S, STILL_IMAGES = 0.1, 8


class Show:
    """The operator's hand: one view after the other, each held still for a moment, until the test is over."""

    def __init__(self, socket: str) -> None:
        photographer = Photographer(CAMERA)
        placed = [*poses(12, 0.36), pose(0.12, 0.09, 0.5), pose(-0.12, -0.09, 0.5), *poses(6, 0.8)]
        self._pictures = [photographer.picture(T) for T in placed]
        self._socket, self._over = socket, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        number = 0
        with KinectEmulator(self._socket) as kinect:
            while not self._over.wait(PERIOD_S):
                if kinect.streaming:
                    picture = self._pictures[number // STILL_IMAGES % len(self._pictures)]
                    kinect.send_frame(picture ^ np.uint8(number & 1), time.time_ns())  # what repeats itself is frozen
                    number += 1

    def __enter__(self) -> Show:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()


@pytest.fixture
def environment(tmp_path: Path) -> Iterator[dict[str, str]]:
    """A master of its own and the camera node on the emulated Kinect."""
    uri = f"http://{HOST}:{free_port()}"
    path = os.pathsep.join(p for p in sys.path if p)
    own = {"ROS_MASTER_URI": uri, "ROS_HOSTNAME": HOST, "ROS_HOME": str(tmp_path), "PYTHONPATH": path}
    shell = {**os.environ, **own}
    master = subprocess.Popen(["rosmaster", "--core", "-p", uri.rsplit(":", 1)[1]], env=shell)
    wait_for(lambda: rosgraph.is_master_online(uri), "the master")
    device = f"_device:=emulator:{tmp_path / 'kinect'}"
    with Show(str(tmp_path / "kinect")):
        camera = subprocess.Popen([sys.executable, str(CHECKOUT / "scripts/camera"), device], env=shell)
        yield shell
        camera.terminate()
        camera.wait(PATIENCE_S)
    master.terminate()
    master.wait(PATIENCE_S)


def test_the_camera_node_gets_and_keeps_its_calibration(environment: dict[str, str], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vsx_ros.cli.main", "calibrate", "camera", "--live", "--board"]
    wrong = subprocess.run(
        [*command, "8x6"], env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (wrong.returncode, wrong.stderr.count("\n")) == (1, 1)
    done = subprocess.run(
        [*command, "8x6x0.03"], env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr + done.stdout
    assert "view 1 taken; still wanted: " in done.stderr
    assert "stored in" in done.stdout
    found = read_calibration(tmp_path / "kinect.yaml")
    assert found.fx == pytest.approx(CAMERA.fx, rel=0.005)
    assert found.cy == pytest.approx(CAMERA.cy, abs=3.0)
