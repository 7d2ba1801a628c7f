"""turn_wheels.py PORT, the robot on a box: the wheels turn 2 s ahead (0.2 m), 2 s to the left, and stop.

Odometry is printed after each; compare it with marks on the wheels.
"""

import math
import sys
import time
from collections import deque

from find_base import find_base

from vsx_hw.bases import base_driver

port, last = sys.argv[1], deque(maxlen=1)
with base_driver(find_base(port), port, last.append) as driver:
    while not last:
        time.sleep(0.1)
    for v, omega in ((0.1, 0.0), (0.0, 0.5)):
        end_s = time.monotonic() + 2.0
        while time.monotonic() < end_s:
            driver.drive(v, omega)
            time.sleep(0.05)
        driver.stop()
        time.sleep(0.7)
        odometry = last[0].odometry
        heading_deg = math.degrees(odometry.heading_rad)
        print(f"x {odometry.x_m:.3f} m, heading {heading_deg:.1f} deg, wheels {odometry.wheels_m}")
