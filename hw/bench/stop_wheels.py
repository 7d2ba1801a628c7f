"""stop_wheels.py PORT, the robot on a box: you should see the wheels turn for 3 s and stop within a second of "killed".

The driver runs in a child process that is killed with SIGKILL; its watchdogs stop the wheels.
"""

import os
import signal
import sys
import time

from find_base import find_base

from vsx_hw.bases import BASES, base_driver
from vsx_hw.watchdog import Watchdogs

if os.fork() == 0:
    port = sys.argv[1]
    kind = find_base(port)
    watchdogs = Watchdogs(port, BASES[kind].baud, BASES[kind].stop_bytes())
    driver = base_driver(kind, port, lambda reading: driver.drive(0.1, 0.0), on_command=watchdogs.beat)
    driver.start()
    time.sleep(4.0)
    print("killed", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
os.wait()
time.sleep(1.0)
