"""A driver in another process with its watchdogs, and a watchdog in a thread."""

import os
import subprocess
import sys
import time

import pytest
from hw_plant import FreeWheels
from hw_watched import Watched
from waiting import wait_for

from vsx_hw.bases import base_emulator
from vsx_hw.kobuki.protocol import WHEEL_BASE_M

DRIVER = """
import sys, time
from vsx_hw.bases import BASES, base_driver
from vsx_hw.watchdog import Watchdogs
watchdogs = Watchdogs(sys.argv[1], 115200, BASES["kobuki"].stop_bytes())
driver = base_driver("kobuki", sys.argv[1], lambda reading: driver.drive(0.2, 0.0), on_command=watchdogs.beat)
driver.start()
time.sleep(60)
"""


@pytest.fixture
def driven(tmp_path):
    """Wheels that a driver in another process lets turn; this process; their emulator."""
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with base_emulator("kobuki", plant, port) as emulator:
        process = subprocess.Popen([sys.executable, "-c", DRIVER, port], env=environment)
        try:
            wait_for(lambda: plant.speeds[0] > 0.1, "it takes long to start on a busy machine")
            time.sleep(0.5)
            wait_for(lambda: plant.speeds[0] > 0.1, "it to drive on")
            yield plant, process, emulator
        finally:
            process.kill()
            process.wait()


@pytest.fixture
def watched(tmp_path, monkeypatch):
    with Watched(str(tmp_path / "ttyKOBUKI"), monkeypatch) as made:
        yield made
