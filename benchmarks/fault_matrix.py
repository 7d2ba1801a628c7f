"""Off, stuck, garbage, wrong, slow, delayed, intermittent: each fault of each device, and what the robot does about it.

python benchmarks/fault_matrix.py [--repetitions 5] [--measure-robot] [--sensors-only] [--table docs/reliability.md]

Sensors of a base: each one broken on each motion, the real driver and mux over the emulated board in simulated time
(tests/hw/hw_sensor_faults.py), and drives on which nothing is broken.
Bases: the real driver with the mux before it, over an emulated base on a pseudo-terminal, commanded 0.2 m/s: how
long the wheels turned after the fault set in, seen at the emulator's end of the wire; where it drove on, it says so.
Camera: the real driver over the emulated Kinect. Nodes, and the camera of an exploring robot: what
benchmarks/fault_nodes.py, fault_master.py and fault_camera.py have measured; with --measure-robot they measure what is
still missing (hours). Disks: what benchmarks/fault_disk.py has measured. With --table the tables replace those of the
document.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vsx_hw.bases import BASES, base_driver
from vsx_hw.emulators import base_emulator
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectEmulator
from vsx_hw.kinect.socket_transport import SocketTransport
from vsx_hw.readings import Hazard
from vsx_hw.safety import SpeedLimits, Supervisor
from vsx_hw.serial_emulator import PlantState

sys.path.append(str(Path(__file__).parents[1] / "tests" / "hw"))
import hw_sensor_faults

FAULTS = ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
WATCH_S = 2.5
BEGIN, END = "<!-- {} begin -->", "<!-- {} end -->"


class Wheels:
    """A plant that obeys at once, whose sensors may be stuck or wrong, and that knows when it was told to stand."""

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


class Base:
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
        faults = self.emulator.faults
        if fault == "off":
            faults.paused = True
        elif fault == "stuck":
            self.wheels.stuck = self.wheels.read()
        elif fault == "garbage":
            faults.garbage_rate = 1.0
        elif fault == "wrong":
            self.wheels.scale = 1.3
        elif fault == "delayed":
            faults.report_delay_ns = faults.command_delay_ns = 200_000_000
        elif fault in ("slow", "intermittent"):
            on_s, off_s = (0.02, 0.1) if fault == "slow" else (0.4, 0.6)
            threading.Thread(target=self.interrupt, args=(on_s, off_s), daemon=True).start()

    def interrupt(self, on_s: float, off_s: float) -> None:
        while not self.closing.is_set():
            self.emulator.faults.paused = True
            time.sleep(off_s)
            self.emulator.faults.paused = False
            time.sleep(on_s)


def until(condition: Callable[[], bool], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def base_fault(kind: str, fault: str, folder: str) -> tuple[float | None, str]:
    """(seconds until the wheels stood, None when they drove on; what the driver said)."""
    base = Base(kind, folder)
    with base.emulator, base.driver:
        base.commander.start()
        if not until(lambda: base.wheels.speeds[0] > 0.1, 10.0):
            raise RuntimeError(f"{kind} does not drive: {base.driver.status()}")
        time.sleep(0.3)
        begin_s = time.monotonic()
        base.inject(fault)
        stopped = until(lambda: not base.wheels.turning, WATCH_S)
        turned_s = base.wheels.stopped_s - begin_s if stopped else None
        time.sleep(0.3 if stopped else 0.0)
        status = base.driver.status()
        said = base.reason if status.connected and base.reason else status.message
        base.closing.set()
        base.commanding = False
        base.commander.join()
    return turned_s, said.replace(f"{folder}/{kind}", "PORT").split(";")[0]


def base_table(repetitions: int, folder: str) -> list[str]:
    lines = ["| base | fault | wheels turned (median, most of n) | what the driver says |", "|---|---|---|---|"]
    for kind in ("kobuki", "create", "create2"):
        for fault in FAULTS:
            runs = [base_fault(kind, fault, folder) for _ in range(repetitions)]
            times = [t for t, _ in runs if t is not None]
            if len(times) == len(runs):
                turned = f"{statistics.median(times):.3f} s, {max(times):.3f} s of {len(times)}"
            else:
                turned = f"drives on ({len(runs) - len(times)} of {len(runs)})"
            lines.append(f"| {kind} | {fault} | {turned} | {runs[-1][1]} |")
            print(lines[-1], flush=True)
    return lines


def camera_fault(fault: str, path: str) -> str:
    """What arrives in two seconds of a fault, and what the driver says."""
    images: list[object] = []
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (480, 640), np.uint8)
    camera = KinectCamera(lambda: SocketTransport(path), "camera", images.append)
    with KinectEmulator(path) as emulator, camera:
        until(lambda: emulator.streaming, 5.0)
        emulator.faults.drop_rate = {"garbage": 1.0 / 81, "intermittent": 0.0}.get(fault, 0.0)
        emulator.faults.silent = fault == "off"
        black = np.zeros_like(picture)
        period_s = 0.1 if fault == "slow" else 1 / 30
        for k in range(round(2.0 / period_s)):
            emulator.faults.silent = fault == "off" or (fault == "intermittent" and k // 15 % 2 == 1)
            late_s = 0.3 if fault == "delayed" else 0.0
            shown = {"wrong": black, "stuck": picture}.get(fault, np.roll(picture, k))
            emulator.send_frame(shown, time.time_ns() - round(late_s * 1e9))
            time.sleep(period_s)
        status = camera.status()
    counters = status.counters
    ages = [r.stamp_ns for r in images]
    even = all(b > a for a, b in zip(ages, ages[1:]))
    return f"{len(images)} images, {counters['torn_frames']} torn, stamps {'rising' if even else 'NOT rising'}"


def camera_table(folder: str) -> list[str]:
    lines = ["| fault of the camera | two seconds at the driver |", "|---|---|"]
    for fault in FAULTS:
        lines.append(f"| {fault} | {camera_fault(fault, folder + '/camera')} |")
        print(lines[-1], flush=True)
    return lines


def node_table() -> list[str]:
    results = json.loads(Path(__file__).with_name("fault_nodes.json").read_text())
    lines = ["| node | what happened to it | wheels turned: median | most | repetitions |", "|---|---|---|---|---|"]
    for name, turned in results.items():
        node, how = name.split()
        if turned:
            worst = "did not stop" if min(turned) < 0 else f"{max(turned):.3f} s"
            lines.append(f"| {node} | {how} | {statistics.median(turned):.3f} s | {worst} | {len(turned)} |")
    return lines


def master_table() -> list[str]:
    rows = [json.loads(line) for line in Path(__file__).with_name("fault_master.jsonl").read_text().splitlines()]
    lines = [
        "| no master for | wheels turned: median, most | moved before it could be stopped | stop path there after "
        "| drives again after | 'vsx stop' stops it |",
        "|---|---|---|---|---|---|",
    ]

    def spread(values: list[float]) -> str:
        return f"{statistics.median(values):.2f} s, {max(values):.2f} s" if values else "-"

    for away_s in sorted({row["away_s"] for row in rows}):
        runs = [row for row in rows if row["away_s"] == away_s]
        driving = [row["driving_s"] for row in runs if row["driving_s"] is not None]
        turned = [row["turned_s"] for row in runs]
        lines.append(
            f"| {away_s:g} s | {'did not stop' if min(turned) < 0 else spread(turned)} "
            f"| {sum(row['moved_before'] for row in runs)} of {len(runs)} | {spread([row['path_s'] for row in runs])} "
            f"| {spread(driving)} of {len(driving)} | {sum(row['stopped'] for row in runs)} of {len(runs)} |"
        )
    return lines


def disk_table() -> list[str]:
    """What became of the runs whose disk failed; one that was not good is named."""
    rows = [json.loads(line) for line in Path(__file__).with_name("fault_disk.jsonl").read_text().splitlines()]
    lines = [
        "| run | fault of the disk | good | ended after its end: median, most | kept its summary |",
        "|---|---|---|---|---|",
    ]
    for how, fault in dict.fromkeys((row["how"], row["fault"]) for row in rows):
        runs = [row for row in rows if (row["how"], row["fault"]) == (how, fault)]
        took = [row["ended after [s]"] for row in runs]
        good, kept = (sum(bool(row[key]) for row in runs) for key in ("good", "summary"))
        times = f"{statistics.median(took):.1f} s, {max(took):.1f} s"
        lines.append(f"| {how} | {fault} | {good} of {len(runs)} | {times} | {kept} |")
    return lines


def robot_table() -> list[str]:
    results = json.loads(Path(__file__).with_name("fault_camera.json").read_text())
    lines = [
        "| fault of the camera | wheels turned (median, most of n) | what the robot says then | four seconds later |",
        "|---|---|---|---|",
    ]
    for name, runs in results.items():
        times = [run["turned_s"] for run in runs if run["turned_s"] >= 0.0]
        on = len(runs) - len(times)
        turned = f"{statistics.median(times):.3f} s, {max(times):.3f} s of {len(times)}" if times else ""
        turned += f" drives on ({on} of {len(runs)})" if on else ""
        said = statistics.mode(f"{run['slam']}; {run['follower']}" for run in runs)
        later = statistics.mode(run["later"].partition(": view at")[0] for run in runs)
        lines.append(f"| {name} | {turned.strip()} | {said} | {later} |")
    return lines


def sensor_table() -> list[str]:
    """One row for a base, a sensor and a fault; the worst of line, arc and spot turn."""
    lines = [
        "| base | sensor | fault | told within | what the robot does | pose jumps by at most | heading off after 4 s |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in ("kobuki", "create", "create2"):
        encoders = [(sensor, fault) for sensor in ("left", "both") for fault in hw_sensor_faults.ENCODER_FAULTS]
        gyro = [("gyro", fault) for fault in hw_sensor_faults.GYRO_FAULTS if kind != "create2"]
        for sensor, fault in encoders + gyro:
            lines.append(sensor_row(kind, sensor, fault))
            print(lines[-1], flush=True)
    return lines


def sensor_row(kind: str, sensor: str, fault: str) -> str:
    done = {}
    for motion in hw_sensor_faults.MOTIONS:
        with pytest.MonkeyPatch.context() as monkeypatch:
            done[motion] = hw_sensor_faults.drive_and_break(kind, motion, sensor, fault, monkeypatch)
    told = max(one.told_s for one in done.values() if one.told_s is not None)
    later = "; on the straight, where it is right, at the next turn" if done["line"].told_s is None else ""
    stood = [one.stood_s for one in done.values()]
    then = "goes on by the wheels" if None in stood else f"stands within {max(stood):.1f} s"
    if fault == "one wrong report":
        then = "goes on, that report left out"
    jump_cm = 100.0 * max(one.jump_m for one in done.values())
    jump, off = (math.degrees(max(abs(getattr(one, k)) for one in done.values())) for k in ("jump_rad", "wrong_rad"))
    name = {"left": "one encoder", "both": "both encoders"}.get(sensor, sensor)
    jumps = f"{jump_cm:.1f} cm, {jump:.1f} deg"
    return f"| {kind} | {name} | {fault} | {told:.1f} s{later} | {then} | {jumps} | {off:.0f} deg |"


def alarm_table(minutes: float = 5.0) -> list[str]:
    """False alarms on drives on which nothing is broken."""
    wheels = {
        "as built": {},
        "both count 10 % too much": {"scales": (1.1, 1.1)},
        "both 10 % too little": {"scales": (0.9, 0.9)},
        "the left one 10 % too much": {"scales": (1.1, 1.0)},
        "5 % each way": {"scales": (0.95, 1.05)},
        "as built, up to 10 % slip": {"slip": 0.1},
    }
    lines = [f"| wheels, {minutes:.0f} minutes each | kobuki | create | create2 |", "|---|---|---|---|"]
    for name, wrong in wheels.items():
        counts = []
        for kind in ("kobuki", "create", "create2"):
            with pytest.MonkeyPatch.context() as monkeypatch:
                counts.append(len(hw_sensor_faults.alarms(kind, minutes, monkeypatch, seed=1, **wrong)))
        lines.append(f"| {name} | {counts[0]} | {counts[1]} | {counts[2]} |")
        print(lines[-1], flush=True)
    return lines


def replace(document: Path, name: str, lines: list[str]) -> None:
    text = document.read_text()
    begin, end = BEGIN.format(name), END.format(name)
    head, _, rest = text.partition(begin)
    _, _, tail = rest.partition(end)
    document.write_text(head + begin + "\n" + "\n".join(lines) + "\n" + end + tail)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--measured-only", action="store_true", help="only the tables of what was measured before")
    parser.add_argument("--measure-robot", action="store_true", help="run the other three first")
    parser.add_argument("--sensors-only", action="store_true", help="only the tables of broken sensors of a base")
    args = parser.parse_args()
    if args.measure_robot:
        for script in ("fault_nodes.py", "fault_master.py", "fault_camera.py"):
            subprocess.run([sys.executable, str(Path(__file__).with_name(script))], check=True)
    tables: dict[str, list[str]] = {}
    if not args.sensors_only:
        tables = {"nodes": node_table(), "masters": master_table(), "robots": robot_table(), "disks": disk_table()}
    if not args.measured_only:
        tables |= {"sensors": sensor_table(), "alarms": alarm_table()}
    if not (args.measured_only or args.sensors_only):
        with tempfile.TemporaryDirectory() as folder:
            tables |= {"cameras": camera_table(folder), "bases": base_table(args.repetitions, folder)}
    for name, lines in tables.items():
        if args.table is not None:
            replace(args.table, name, lines)


if __name__ == "__main__":
    main()
