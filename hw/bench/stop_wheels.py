"""stop_wheels.py PORT, the robot on a box: you should see the wheels turn for 2 s and stop within a second of "killed".

The driver runs in a child process that is killed with SIGKILL; its guardian stops the wheels.
"""

import os
import signal
import sys
import time

from bench_base import driver_at

from vsx_hw.guardian import Guardian, StopBytes

if os.fork() == 0:
    driver = driver_at(sys.argv[1], lambda reading: driver.drive(0.1, 0.0))
    baud = driver._dialect._model.baud if hasattr(driver._dialect, "_model") else 115200
    guardian = Guardian(sys.argv[1], baud, StopBytes(driver._dialect.halt(), driver._dialect.farewell()))
    driver._on_command = guardian.beat
    driver.start()
    time.sleep(4.0)
    print("killed", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
os.wait()
time.sleep(1.0)
