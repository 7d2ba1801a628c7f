"""watch_kinect.py [SERIAL]: you should see 30 images a second, 0 torn, and after 2 s a locked exposure. Ctrl-C ends.

A Kinect 1414 also tells gravity, (0, 1, 0) g when it stands level, and how its base leans: 0 and 0 degrees.
"""

import math
import sys
import time

from vsx_hw.errors import DeviceError
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.tilt import read_tilt_state
from vsx_hw.kinect.usb_transport import UsbTransport

try:
    tilt = read_tilt_state()
    lean = f"pitch {math.degrees(tilt.pitch_rad):.1f} deg, roll {math.degrees(tilt.roll_rad):.1f} deg"
    print(f"gravity {tuple(round(g, 2) for g in tilt.gravity_g)} g, {lean}, tilt of the head {tilt.tilt_deg} deg")
except DeviceError as error:
    print(error)
serial = sys.argv[1] if len(sys.argv) > 1 else ""
images = []
with KinectCamera(lambda: UsbTransport(serial), "kinect", images.append, lock_exposure=True) as camera:
    try:
        while True:
            time.sleep(1.0)
            heard, images[:] = images[:], []
            brightness = f"mean {heard[-1].image.mean():.0f}" if heard else camera.status().message
            print(f"{camera.serial}: {len(heard)} a second, {brightness}, {camera.status().counters}")
    except KeyboardInterrupt:
        print(camera.status())
