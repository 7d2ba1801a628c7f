"""The wheels stop although the driver was killed or hangs."""

import os
import signal
import subprocess
import sys
import time

import pytest
from hw_plant import FreeWheels, until

from vsx_hw.bases import BASES
from vsx_hw.guardian import Guardian, take_over
from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.emulator import kobuki_emulator
from vsx_hw.kobuki.protocol import BAUD

STOP = BASES["kobuki"].stop_bytes()

DRIVER = """
import sys, time
from vsx_hw.bases import BASES, base_driver
from vsx_hw.guardian import Guardian
guardian = Guardian(sys.argv[1], 115200, BASES["kobuki"].stop_bytes())
driver = base_driver("kobuki", sys.argv[1], lambda reading: driver.drive(0.2, 0.0), on_command=guardian.beat)
driver.start()
time.sleep(60)
"""


@pytest.fixture
def driven(tmp_path):
    """Wheels that a driver in another process lets turn."""
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with kobuki_emulator(plant, port):
        process = subprocess.Popen([sys.executable, "-c", DRIVER, port], env=environment)
        try:
            assert until(lambda: plant.speeds[0] > 0.1)
            time.sleep(0.5)
            assert plant.speeds[0] > 0.1
            yield plant, process
        finally:
            process.kill()
            process.wait()


def test_a_killed_driver_leaves_the_wheels_stopped(driven):
    plant, process = driven
    process.kill()
    process.wait()
    assert until(lambda: plant.speeds == (0.0, 0.0))


def test_a_hanging_driver_leaves_the_wheels_stopped_and_may_go_on_later(driven):
    plant, process = driven
    process.send_signal(signal.SIGSTOP)
    assert until(lambda: plant.speeds == (0.0, 0.0))
    time.sleep(0.3)
    assert plant.speeds == (0.0, 0.0)
    process.send_signal(signal.SIGCONT)
    assert until(lambda: plant.speeds[0] > 0.1)


def test_a_released_guardian_does_not_touch_the_port(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    with kobuki_emulator(plant, port):
        guardian = Guardian(port, BAUD, STOP)
        guardian.beat(True)
        guardian.release()
        time.sleep(0.05)
        assert plant.speeds == (0.1, 0.1)
        assert take_over(port, BAUD, STOP.farewell)
        assert until(lambda: plant.speeds == (0.0, 0.0))


def test_a_driver_that_stands_is_left_alone_by_its_guardian(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    with kobuki_emulator(plant, port):
        guardian = Guardian(port, BAUD, STOP)
        guardian.beat(False)
        time.sleep(0.6)
        assert plant.speeds == (0.1, 0.1)
        guardian.beat(True)
        assert until(lambda: plant.speeds == (0.0, 0.0))
        guardian.release()


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_guardian_that_is_killed_or_hangs_is_missed_and_replaced(tmp_path, monkeypatch, end):
    monkeypatch.setattr("vsx_hw.guardian.PATIENCE_S", 0.0)
    guardian = Guardian(str(tmp_path / "nothing"), BAUD, STOP)

    def answers():
        guardian.beat(False)
        return guardian.answers

    assert until(answers)
    first = guardian._process
    guardian.revive()
    assert guardian._process is first
    first.send_signal(end)
    assert until(lambda: not answers())
    guardian.revive()
    assert until(answers)
    assert guardian._process.pid != first.pid
    assert first.poll() is not None
    guardian.release()
    last = guardian._process
    assert last.returncode == 0
    guardian.beat(False)
    guardian.revive()
    assert guardian._process is last, "it was let go"


def test_a_guardian_that_nobody_beats_is_well(tmp_path):
    guardian = Guardian(str(tmp_path / "nothing"), BAUD, STOP)
    assert until(lambda: guardian.answers)
    time.sleep(0.4)
    assert guardian.answers
    guardian.release()


def test_a_guardian_that_does_not_start_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    guardian = Guardian(str(tmp_path / "nothing"), BAUD, STOP)
    guardian.beat(False)
    assert not until(lambda: guardian.answers, 0.5)
    guardian.release()
