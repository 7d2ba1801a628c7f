"""Off, stuck, garbage, wrong, slow, delayed, intermittent: how the robot reacts to each fault of each device.

python benchmarks/fault_matrix.py [--repetitions 5]

Bases: the real driver behind the mux, over an emulated base on a pseudo-terminal, commanded 0.2 m/s: how long the
wheels turned after the start of the fault, measured at the emulator's end of the wire, or that it drove on.
Camera: the real driver over the emulated Kinect. Each repetition writes a row; benchmarks/tables.py makes the tables.
"""

import argparse
import tempfile
import threading
import time
from collections import namedtuple
from collections.abc import Callable
from functools import partial
from itertools import product

import numpy as np
from tables import campaign

from vsx_hw.bases import BASES, base_driver, base_emulator
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectEmulator
from vsx_hw.kinect.socket_transport import SocketTransport
from vsx_hw.readings import Hazard
from vsx_hw.safety import SpeedLimits, Supervisor
from vsx_hw.serial_emulator import PlantState
from vsx_ros.experiments.campaign import UntriedError

FailingBase = namedtuple("FailingBase", "base fault repetition")
FailingCamera = namedtuple("FailingCamera", "fault")
FAULTS = ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
WATCH_S = 2.5


class Wheels:
    """A plant that obeys at once, records when it was told to stand, and whose sensors may be stuck or wrong."""

    def __init__(self, wheel_base_m: float) -> None:
        self.wheel_base_m = wheel_base_m
        self.speeds, self.travel = (0.0, 0.0), [0.0, 0.0]
        self.stopped_s = 0.0
        self.stuck: PlantState | None = None
        self.scale = 1.0

    @property
    def turning(self) -> bool:
        return self.speeds != (0.0, 0.0)

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        if self.turning and (left_m_s, right_m_s) == (0.0, 0.0):
            self.stopped_s = time.monotonic()
        self.speeds = (left_m_s, right_m_s)

    def advance(self, dt_ns: int) -> None:
        for side in (0, 1):
            self.travel[side] += self.scale * self.speeds[side] * dt_ns * 1e-9

    def read(self) -> PlantState:
        if self.stuck is not None:
            return self.stuck
        left, right = self.travel
        turn, rate = (right - left) / self.wheel_base_m, (self.speeds[1] - self.speeds[0]) / self.wheel_base_m
        return PlantState(left, right, turn, rate, Hazard.NONE)


class DrivenBase:
    """Emulated base, real driver, real mux; ``commanding`` sends 0.2 m/s twenty times a second."""

    def __init__(self, kind: str, folder: str) -> None:
        port = f"{folder}/{kind}"
        self.wheels = Wheels(BASES[kind].wheel_base_m)
        self.supervisor, self.reason = Supervisor(SpeedLimits()), ""
        self.commanding = True
        self.emulator = base_emulator(kind, self.wheels, port)
        self.driver = base_driver(kind, port, self.on_reading)
        self.closing = threading.Event()
        self.commander = threading.Thread(target=self.command, daemon=True)

    def on_reading(self, reading: object) -> None:
        now_ns = time.monotonic_ns()
        decision = self.supervisor.decide(now_ns, reading.hazards)
        self.supervisor.observe(reading.odometry.fault)
        self.reason = decision.reason
        self.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)

    def command(self) -> None:
        while not self.closing.wait(0.05):
            if self.commanding:
                self.supervisor.command("navi", 0.2, 0.0, time.monotonic_ns())

    def inject(self, fault: str) -> None:
        if fault == "off":
            self.emulator.paused = True
        elif fault == "stuck":
            self.wheels.stuck = self.wheels.read()
        elif fault == "garbage":
            self.emulator.garbage_rate = 1.0
        elif fault == "wrong":
            self.wheels.scale = 1.3
        elif fault == "delayed":
            self.emulator.report_delay_ns = self.emulator.command_delay_ns = 200_000_000
        elif fault in ("slow", "intermittent"):
            on_s, off_s = (0.02, 0.1) if fault == "slow" else (0.4, 0.6)
            threading.Thread(target=self.interrupt, args=(on_s, off_s), daemon=True).start()

    def interrupt(self, on_s: float, off_s: float) -> None:
        while not self.closing.is_set():
            self.emulator.paused = True
            time.sleep(off_s)
            self.emulator.paused = False
            time.sleep(on_s)


def until(condition: Callable[[], bool], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def base_fault(folder: str, task: FailingBase) -> dict[str, object]:
    """turned_s: until the wheels stood, -1 if they drove on. said: the driver's message."""
    base = DrivenBase(task.base, folder)
    with base.emulator, base.driver:
        base.commander.start()
        if not until(lambda: base.wheels.speeds[0] > 0.1, 10.0):
            raise UntriedError(f"{task.base} does not drive: {base.driver.status()}")
        time.sleep(0.3)
        begin_s = time.monotonic()
        base.inject(task.fault)
        stopped = until(lambda: not base.wheels.turning, WATCH_S)
        turned_s = base.wheels.stopped_s - begin_s if stopped else -1.0
        time.sleep(0.3 if stopped else 0.0)
        status = base.driver.status()
        said = base.reason if status.connected and base.reason else status.message
        base.closing.set()
        base.commanding = False
        base.commander.join()
    return {"turned_s": round(turned_s, 3), "said": said.replace(f"{folder}/{task.base}", "PORT").split(";")[0]}


def camera_fault(folder: str, task: FailingCamera) -> dict[str, str]:
    """The images received in two seconds of a fault."""
    fault, path = task.fault, f"{folder}/camera"
    images: list[object] = []
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (480, 640), np.uint8)
    camera = KinectCamera(lambda: SocketTransport(path), "camera", images.append)
    with KinectEmulator(path) as emulator, camera:
        until(lambda: emulator.streaming, 5.0)
        emulator.drop_rate = {"garbage": 1.0 / 81, "intermittent": 0.0}.get(fault, 0.0)
        emulator.silent = fault == "off"
        black = np.zeros_like(picture)
        period_s = 0.1 if fault == "slow" else 1 / 30
        for k in range(round(2.0 / period_s)):
            emulator.silent = fault == "off" or (fault == "intermittent" and k // 15 % 2 == 1)
            late_s = 0.3 if fault == "delayed" else 0.0
            shown = {"wrong": black, "stuck": picture}.get(fault, np.roll(picture, k))
            emulator.send_frame(shown, time.time_ns() - round(late_s * 1e9))
            time.sleep(period_s)
        status = camera.status()
    counters = status.counters
    ages = [r.stamp_ns for r in images]
    even = all(b > a for a, b in zip(ages, ages[1:]))
    counted = f"{len(images)} images, {counters['torn_frames']} torn, stamps {'rising' if even else 'NOT rising'}"
    return {"arrived": counted}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    args = parser.parse_args()
    cameras = [FailingCamera(fault) for fault in FAULTS]
    bases = list(map(FailingBase._make, product(("kobuki", "create", "create2"), FAULTS, range(args.repetitions))))
    with tempfile.TemporaryDirectory() as folder:
        campaign("fault_cameras", cameras, partial(camera_fault, folder))
        campaign("fault_bases", bases, partial(base_fault, folder))


if __name__ == "__main__":
    main()
