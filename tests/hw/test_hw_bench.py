"""The commands for the first hour with a robot, beside an emulated one; and the stop bytes of the service manager."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
import serial
from hw_plant import FreeWheels
from waiting import PATIENCE_S, wait_for

from vsx_hw.bases import base_emulator
from vsx_hw.create.protocol import CREATE_2
from vsx_hw.kobuki.protocol import WHEEL_BASE_M, encode_frame

BENCH = str(Path(__file__).resolve().parents[2] / "hw" / "bench.py")
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "PYTHONUNBUFFERED": "1"}


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE_S
    )


@pytest.fixture
def kobuki(tmp_path):
    plant, port = FreeWheels(WHEEL_BASE_M), str(tmp_path / "ttyKOBUKI")
    with base_emulator("kobuki", plant, port):
        yield plant, port


def test_the_wheels_turn_as_announced(kobuki):
    plant, port = kobuki
    done = run(BENCH, "turn", port)
    assert done.returncode == 0, done.stderr
    assert plant.speeds == (0.0, 0.0)
    left, right = plant.travel
    assert 0.5 * (left + right) == pytest.approx(0.2, abs=0.06)
    assert (right - left) / WHEEL_BASE_M == pytest.approx(1.0, abs=0.3)


def test_a_killed_driver_is_shown_to_stop(kobuki):
    plant, port = kobuki
    done = run(BENCH, "stop", port)
    assert "killed" in done.stdout, done.stderr
    assert plant.travel[0] > 0.1
    assert plant.speeds == (0.0, 0.0)


def test_a_kobuki_tells_what_it_is_and_takes_back_the_gains_of_the_factory(kobuki):
    _, port = kobuki
    with serial.Serial(port) as line:
        line.write(encode_frame(struct.pack("<BBB3I", 13, 13, 1, 50_000, 200, 3_000)))
    asked = run(BENCH, "ask", port)
    assert asked.stdout.splitlines() == [
        "hardware_version: 1.0.4",
        "firmware_version: 1.2.0",
        "udid: (1, 2, 3)",
        "current: (0, 0)",
        "cliff_adc: (1600, 1900, 1600)",
        "gains: kind 1, 50, 0.2, 3",
    ], asked.stderr
    assert "gains: kind 0, 100, 0.1, 2" in run(BENCH, "ask", port, "--factory-gains").stdout


def test_a_create_is_found_and_told_to_stop(tmp_path):
    plant, port = FreeWheels(CREATE_2.wheel_base_m), str(tmp_path / "ttyCREATE")
    with base_emulator("create2", plant, port) as emulator:
        assert "create2" in run(BENCH, "find", port).stdout
        plant.speeds = (0.1, 0.1)
        done = run("-c", "import vsx_hw.bases as b; b.main()", port, "create2")
        assert done.returncode == 0, done.stderr
        end = bytes((145, 0, 0, 0, 0, 128, 173))
        wait_for(lambda: bytes(emulator._board.log).endswith(end), "the last bytes")
    assert "create" in run("-c", "import vsx_hw.bases as b; b.main()", port, "tricycle").stderr


@pytest.mark.parametrize("module", ["vsx_hw.bases", "vsx_hw.watchdog"])
def test_what_stops_the_wheels_loads_nothing_heavy(module):
    heavy = ("numpy", "cv2", "usb1", "rospy")
    done = run("-c", f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])")
    assert done.stdout.strip() == "[]", done.stderr
