"""stop_wheels.py PORT, the robot on a box: you should see the wheels turn for 3 s and stop within a second of "killed".

The driver runs in a child process that is killed with SIGKILL; its watchdogs stop the wheels.
"""

import os
import signal
import sys
import time

from bench_base import BenchBase

from vsx_hw.bases import BASES
from vsx_hw.watchdog import Watchdogs

if os.fork() == 0:
    base = BenchBase(sys.argv[1])
    watchdogs = Watchdogs(base.port, BASES[base.kind].baud, BASES[base.kind].stop_bytes())
    driver = base.driver(lambda reading: driver.drive(0.1, 0.0), watchdogs.beat)
    driver.start()
    time.sleep(4.0)
    print("killed", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
os.wait()
time.sleep(1.0)
