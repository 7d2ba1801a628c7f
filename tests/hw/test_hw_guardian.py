"""The wheels stop although the driver was killed."""

import os
import subprocess
import sys
import time

from hw_plant import FreeWheels

from vsx_hw.guardian import RELEASED, Guardian, watch
from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.emulator import kobuki_emulator
from vsx_hw.kobuki.protocol import BAUD

DRIVER = """
import sys, time
from vsx_hw.guardian import Guardian
from vsx_hw.kobuki.driver import KobukiDialect, kobuki_driver
guardian = Guardian(sys.argv[1], 115200, KobukiDialect().farewell())
driver = kobuki_driver(sys.argv[1], lambda reading: driver.drive(0.2, 0.0))
driver.start()
time.sleep(60)
"""


def until(condition, timeout_s=10.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def test_a_killed_driver_leaves_the_wheels_stopped(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with kobuki_emulator(plant, port):
        process = subprocess.Popen([sys.executable, "-c", DRIVER, port], env=environment)
        try:
            assert until(lambda: plant.speeds[0] > 0.1)
            time.sleep(0.5)
            assert plant.speeds[0] > 0.1
        finally:
            process.kill()
            process.wait()
        assert until(lambda: plant.speeds == (0.0, 0.0))


def test_a_released_guardian_does_not_touch_the_port(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    with kobuki_emulator(plant, port):
        guardian = Guardian(port, BAUD, KobukiDialect().farewell())
        guardian.release()
        assert not watch(port, BAUD, KobukiDialect().farewell(), RELEASED)
        time.sleep(0.05)
        assert plant.speeds == (0.1, 0.1)
        assert watch(port, BAUD, KobukiDialect().farewell(), b"")
        assert until(lambda: plant.speeds == (0.0, 0.0))
