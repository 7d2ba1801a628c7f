"""Hours on emulated devices that fail repeatedly: memory, threads and pose compared with a run without faults.

python benchmarks/soak.py [--minutes 60] [--base kobuki]

A base drives squares with its real driver and mux, and a Kinect streams through its real driver. Every few seconds
there is one fault (bytes lost or changed, silence, unplugging, power cycles, lost packets). At the end it prints:
exceptions of the drivers, growth of memory after the first minute, threads, and the odometry's error against the
emulated wheels, each also for a run without faults.
"""

import argparse
import logging
import math
import random
import tempfile
import threading
import time

import numpy as np
from fault_matrix import DrivenBase, until

from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectEmulator
from vsx_hw.kinect.socket_transport import SocketTransport

SIDE_S, TURN_S = 4.0, 3.2


def memory_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096 / 2**20


class Told(logging.Handler):
    """Counts tracebacks in the drivers' logs."""

    def __init__(self) -> None:
        super().__init__()
        self.exceptions: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self.exceptions.append(record.getMessage())


def command_squares(base: DrivenBase) -> None:
    """0.2 m/s along the sides, 0.5 rad/s at the corners, without end."""
    begin_s = time.monotonic()
    while not base.closing.wait(0.05):
        phase_s = (time.monotonic() - begin_s) % (SIDE_S + TURN_S)
        v, omega = (0.2, 0.0) if phase_s < SIDE_S else (0.0, 0.5)
        base.supervisor.command("navi", v, omega, time.monotonic_ns())


def base_fault(base: DrivenBase, rng: random.Random) -> None:
    """One fault of one or two seconds; only unplugging and power cycles may lose motion."""
    emulator = base.emulator
    kind = rng.randrange(4)
    if kind == 0:
        emulator.drop_rate = emulator.garbage_rate = 0.001
        time.sleep(2.0)
        emulator.drop_rate = emulator.garbage_rate = 0.0
    elif kind == 1:
        emulator.paused = True
        time.sleep(0.3)
        emulator.paused = False
    elif kind == 2:
        base.supervisor.hold = "soak: standing for the cable"
        time.sleep(0.5)
        emulator.unplug()
        time.sleep(0.5)
        emulator.replug()
        until(lambda: base.driver.status().connected, 10.0)
        base.supervisor.hold = ""
    else:
        emulator.command_delay_ns = 100_000_000
        time.sleep(1.0)
        emulator.command_delay_ns = 0


def stream(emulator: KinectEmulator, closing: threading.Event, rng: random.Random, faulty: bool) -> None:
    """Thirty images a second; sometimes packets are lost or the camera is unplugged."""
    picture = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)
    for k in range(10**9):
        if closing.wait(1 / 30):
            return
        if faulty and k % 300 == 299:
            emulator.drop_rate = rng.choice((0.0, 0.001))
        if faulty and k % 1800 == 1799:
            emulator.unplug()
        emulator.send_frame(picture ^ np.uint8(k & 1), time.time_ns())


def run(kind: str, minutes: float, faulty: bool, folder: str) -> dict[str, float]:
    rng = random.Random(1)
    base = DrivenBase(kind, folder)
    readings: list[object] = [None]
    inner = base.driver._on_reading

    def keep(reading: object) -> None:
        readings[0] = reading
        inner(reading)

    base.driver._on_reading = keep
    base.commander = threading.Thread(target=command_squares, args=(base,), daemon=True)
    closing = threading.Event()
    images = [0]

    def count(_: object) -> None:
        images[0] += 1

    path = f"{folder}/camera{faulty}"
    camera = KinectCamera(lambda: SocketTransport(path), "camera", count)
    end_s, warm_s, warm_mb = time.monotonic() + 60 * minutes, time.monotonic() + min(60.0, 15 * minutes), 0.0
    with KinectEmulator(path) as emulator, camera, base.emulator, base.driver:
        base.commander.start()
        threading.Thread(target=stream, args=(emulator, closing, rng, faulty), daemon=True).start()
        while time.monotonic() < end_s:
            time.sleep(3.0)
            if faulty:
                base_fault(base, rng)
            if not warm_mb and time.monotonic() > warm_s:
                warm_mb = memory_mb()
        base.closing.set()
        closing.set()
        base.commander.join()
        time.sleep(1.0)
        error = pose_error(base, readings[0])
        counters = {f"base {k}": v for k, v in base.driver.status().counters.items()}
        counters |= {f"camera {k}": v for k, v in camera.status().counters.items()}
    return {**error, "images": images[0], "memory_growth_mb": round(memory_mb() - warm_mb, 2), **counters}


def pose_error(base: DrivenBase, reading: object) -> dict[str, float]:
    """Path and turn of the odometry compared with the emulated wheels."""
    left, right = base.wheels.travel
    way, turn = 0.5 * (left + right), (right - left) / base.wheels.wheel_base_m
    odometry = reading.odometry
    way_told = 0.5 * sum(odometry.wheels_m)
    return {
        "way_m": round(way, 3),
        "way_error_percent": round(100 * abs(way_told - way) / way, 3),
        "turn_rad": round(turn, 2),
        "turn_error_percent": round(100 * abs(odometry.heading_rad - turn) / abs(turn), 3),
        "gaps": odometry.gaps,
        "turns": round(turn / math.tau, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--base", choices=("kobuki", "create", "create2"), default="kobuki")
    args = parser.parse_args()
    told = Told()
    logging.getLogger("vsx_hw").addHandler(told)
    logging.getLogger("vsx_hw").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        for faulty, minutes in ((False, min(args.minutes, 1.0)), (True, args.minutes)):
            result = run(args.base, minutes, faulty, folder)
            print(f"{minutes:g} minutes {'with' if faulty else 'without'} faults: {result}", flush=True)
    print(f"exceptions: {told.exceptions}, threads left: {threading.active_count()}")


if __name__ == "__main__":
    main()
