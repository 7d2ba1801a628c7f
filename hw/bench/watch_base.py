"""watch_base.py PORT: you should see, once a second, the rate of readings, battery, buttons and what is touched.

Press each bumper, lift each wheel, hold paper under each cliff sensor: its own name appears. No wheel turns.
"""

import math
import sys
import time

from find_base import find_base

from vsx_hw.bases import base_driver
from vsx_hw.readings import Hazard

port, readings = sys.argv[1], []
with base_driver(find_base(port), port, readings.append) as driver:
    try:
        while True:
            time.sleep(1.0)
            heard, readings[:] = readings[:], []
            if not heard:
                print(driver.status().message)
                continue
            touched, last = Hazard.NONE, heard[-1]
            for reading in heard:
                touched |= reading.hazards
            gyro = "none" if last.gyro is None else f"{math.degrees(last.gyro.rate_rad_s):.1f} deg/s"
            print(
                f"{len(heard)} a second, {last.battery.voltage_v:.1f} V {last.battery.state}, {last.mode or '-'}, "
                f"buttons {last.buttons}, gyro {gyro}, touched: {touched.name or 'nothing'}"
            )
    except KeyboardInterrupt:
        print(driver.status())
