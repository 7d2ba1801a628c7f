"""A base of a user's own module, through the node mobile_base: who stops it when that node or its driver dies."""

import os
import pty
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from lone_base import HAND, LoneBase

from vsx_ros.registry import PLUGINS

pytestmark = [pytest.mark.ros, pytest.mark.light]

WIRED = """
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import BAUD
from vsx_ros.ros.base_drivers import BASES, at_port

BASES.add("mine", at_port(BAUD, KobukiDialect))
"""

CARELESS = """
import threading, time
from pathlib import Path
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, LinkStatus, OdometryReading
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import StopBytes
from vsx_ros.ros.base_drivers import BASES, BaseEntry

class Careless:
    def __init__(self, settings, hears):
        self._hears, self._end = hears, Path(settings.port + ".end")
        self._port = SerialTransport(settings.port, 115200)

    def start(self):
        threading.Thread(target=self._run, daemon=True).start()

    def drive(self, v_m_s, omega_rad_s, until_ns=None):
        self._port.write(b"drive %.2f;" % v_m_s)

    def show(self, signal):
        pass

    def reset_odometry(self):
        pass

    def status(self):
        return LinkStatus(True, "connected", "careless", {})

    def close(self):
        self._port.close()
        return True

    def _run(self):
        while not self._end.exists():
            now_ns = time.time_ns()
            battery = BatteryReading(12.0, 1.0, False, "full")
            odometry = OdometryReading(now_ns, 0.0, 0.0, 0.0, 0.0, 0.0)
            self._hears.on_reading(BaseReading(now_ns, odometry, Hazard.NONE, battery))
            self._hears.on_command(True)
            time.sleep(0.02)

BASES.add("careless", BaseEntry(Careless, StopBytes(b"halt;", b"farewell;"), 115200))
"""


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LoneBase]:
    for name, text in {"my_wired": WIRED, "my_careless": CARELESS}.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(PLUGINS, "my_wired,my_careless")
    made = LoneBase(tmp_path)
    made.processes.start("hand", "python3", "-c", HAND)
    yield made
    made.close()


def test_a_killed_node_leaves_a_base_of_one_s_own_standing(base: LoneBase) -> None:
    node = base.start("mobile_base", "_robot_type:=mine", f"_port:={base.port}")
    base.processes.wait(lambda: base.plant.turns, "the hand to drive")
    node.kill()
    node.wait()
    base.processes.wait(lambda: not base.plant.turns, "the watchdogs to stop the wheels")


class Line:
    """The base's end of a serial port; heard: all bytes that were written to it."""

    def __init__(self, port: str) -> None:
        self.heard = b""
        self._end, near = pty.openpty()
        tty.setraw(near)
        os.symlink(os.ttyname(near), port)
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            self.heard += os.read(self._end, 4096)


def test_a_driver_that_says_connected_with_a_dead_thread_ends_the_node_and_the_drive(base: LoneBase) -> None:
    line = Line(base.port + "2")
    node = base.start("mobile_base", "_robot_type:=careless", f"_port:={base.port}2")
    base.processes.wait(lambda: b"drive 0.05;" in line.heard, "the hand to drive")
    Path(base.port + "2.end").touch()
    before = len(line.heard)
    base.processes.wait(lambda: b"drive 0.00;" in line.heard[before:], "the wheels to be told to stand")
    base.processes.wait(lambda: node.poll() is not None, "the node to end")
    assert node.returncode == 2
    assert "no reading for" in base.processes.logs()
    base.processes.wait(lambda: line.heard.endswith(b"farewell;"), "the watchdogs, since no driver knows any better")
    time.sleep(0.3)
    assert b"drive" not in line.heard.rpartition(b"drive 0.00;")[2]
