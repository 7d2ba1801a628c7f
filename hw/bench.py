"""The first hour with a robot, step by step. docs/hardware.md gives the order and what you should see.

find PORT: shows the kind of base. watch PORT: also shows its reports once a second (Ctrl-C ends). No wheel turns.
ask PORT [--factory-gains]: for a Kobuki. Plays a note; shows versions, identity, motor currents [10 mA], cliff sensors
    (right, centre, left, 4095 is 3.3 V) and wheel gains. --factory-gains sets the gains first. No wheel turns.
turn PORT: the wheels turn 2 s ahead (0.2 m), 2 s to the left, and stop; compare odometry with marks on the wheels.
stop PORT: the wheels turn 3 s; then SIGKILL ends the driver's process, and its watchdogs stop them within a second.
kinect [SERIAL]: shows rate, brightness, counters (Ctrl-C ends). A Kinect 1414 also shows gravity, (0, 1, 0) g when it
    stands level, and the pitch and roll of its base: 0 and 0 degrees."""

import math
import os
import signal
import sys
import time
from collections import deque
from functools import reduce
from operator import or_

from vsx_hw.bases import BASES, base_driver, detect_base
from vsx_hw.errors import DeviceError
from vsx_hw.kobuki import protocol
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import Watchdogs


def _find(port):
    kind = detect_base(port)
    print(f"{port}: {kind} at {BASES[kind].baud} baud", flush=True)
    return kind


def _say_each_second(driver, readings, line):
    try:
        while True:
            time.sleep(1.0)
            heard, readings[:] = readings[:], []
            print(line(heard))
    except KeyboardInterrupt:
        print(driver.status())


def _watch(port):
    def line(heard):
        if not heard:
            return driver.status().message
        last, touched = heard[-1], reduce(or_, (reading.hazards for reading in heard))
        gyro = "none" if last.gyro is None else f"{math.degrees(last.gyro.rate_rad_s):.1f} deg/s"
        return (
            f"{len(heard)} a second, {last.battery.voltage_v:.1f} V {last.battery.state}, {last.mode or '-'}, "
            f"buttons {last.buttons}, gyro {gyro}, touched: {touched.name or 'nothing'}"
        )

    readings = []
    with base_driver(_find(port), port, readings.append) as driver:
        _say_each_second(driver, readings, line)


def _ask(port, *options):
    transport, parser, told = SerialTransport(port, protocol.BAUD), StreamParser(), {}
    if "--factory-gains" in options:
        transport.write(protocol.encode_frame(protocol.factory_gains_payload()))
    sound, versions = protocol.sound_payload(440.0, 200), protocol.request_versions_payload()
    transport.write(protocol.encode_frame(sound, versions, protocol.get_gains_payload()))
    end_s = time.monotonic() + 2.0
    while time.monotonic() < end_s:
        for feedback in parser.feed(transport.read(0.1)):
            told |= {name: value for name, value in feedback._asdict().items() if value is not None}
    for name in ("hardware_version", "firmware_version", "udid", "current", "cliff_adc"):
        print(f"{name}: {told.get(name, 'not told')}")
    kind, *factors = told.get("controller", (None,))
    print("gains: not told" if kind is None else f"gains: kind {kind}, {', '.join(f'{f / 1e3:g}' for f in factors)}")
    transport.close()


def _turn(port):
    last = deque(maxlen=1)
    with base_driver(_find(port), port, last.append) as driver:
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


def _stop(port):
    if os.fork() == 0:
        kind = _find(port)
        watchdogs = Watchdogs(port, BASES[kind].baud, BASES[kind].stop_bytes())
        driver = base_driver(kind, port, lambda reading: driver.drive(0.1, 0.0), on_command=watchdogs.beat)
        driver.start()
        time.sleep(4.0)
        print("killed", flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    os.wait()
    time.sleep(1.0)


def _kinect(serial=""):
    from vsx_hw.kinect.driver import KinectCamera
    from vsx_hw.kinect.tilt import read_tilt_state
    from vsx_hw.kinect.usb_transport import UsbTransport

    try:
        tilt = read_tilt_state()
        lean = f"pitch {math.degrees(tilt.pitch_rad):.1f} deg, roll {math.degrees(tilt.roll_rad):.1f} deg"
        print(f"gravity {tuple(round(g, 2) for g in tilt.gravity_g)} g, {lean}, tilt of the head {tilt.tilt_deg} deg")
    except DeviceError as error:
        print(error)

    def line(heard):
        brightness = f"mean {heard[-1].image.mean():.0f}" if heard else camera.status().message
        return f"{camera.serial}: {len(heard)} a second, {brightness}, {camera.status().counters}"

    images = []
    with KinectCamera(lambda: UsbTransport(serial), "kinect", images.append, lock_exposure=True) as camera:
        _say_each_second(camera, images, line)


if __name__ == "__main__":
    commands = {"find": _find, "watch": _watch, "ask": _ask, "turn": _turn, "stop": _stop, "kinect": _kinect}
    if len(sys.argv) < 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]](*sys.argv[2:])
