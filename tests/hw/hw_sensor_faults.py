"""One sensor of a driven base breaks: the real driver and the real mux over the emulated board, in simulated time."""

import math
import random
from collections import deque
from typing import NamedTuple

from hw_wire import MS, Wire

from vsx_hw.bases import BASES
from vsx_hw.odometry import PlanarPose
from vsx_hw.readings import Hazard
from vsx_hw.safety import SpeedLimits, Supervisor
from vsx_hw.serial_emulator import PlantState

MOTIONS = {
    "line": (0.2, 0.0),
    "reverse": (-0.2, 0.0),
    "arc": (0.2, 0.4),
    "right arc": (0.2, -0.4),
    "spot turn": (0.0, 0.4),
}
ENCODER_FAULTS = ("dead", "stuck", "double", "backwards")
DRIFTS_RAD_S = {"drift to the left": math.radians(5.0), "drift to the right": math.radians(-5.0)}
GYRO_FAULTS = ("stuck", "one wrong report", *DRIFTS_RAD_S, "wrong sign")
DEAD_TIME_NS = {"kobuki": 200 * MS, "create": 60 * MS, "create2": 60 * MS}
LAG_S, SLIP = 0.08, 0.02
REPORT_NS = 20 * MS


class SlippingWheels:
    """Wheels with dead time, lag and slip, of which each sensor may break. scales: (left, right) counted per rolled
    way.

    sensor: "left", "right", "both" or "gyro", and how it is broken, see ENCODER_FAULTS and GYRO_FAULTS.
    """

    def __init__(self, kind: str, seed: int = 0, scales: tuple[float, float] = (1.0, 1.0), slip: float = SLIP) -> None:
        self.wheel_base_m, self._dead_time_ns = BASES[kind].wheel_base_m, DEAD_TIME_NS[kind]
        self.hazards = Hazard.NONE
        self.truth = PlanarPose()
        self._rng, self._slip = random.Random(seed), slip
        self._scales = list(scales)
        self._commands: deque = deque()
        self._wanted, self._speeds, self._slipping = (0.0, 0.0), [0.0, 0.0], [1.0, 1.0]
        self._counted, self._gyro_rad, self._rate = [0.0, 0.0], 0.0, 0.0
        self._gyro_scale, self._drift, self._wrong_until_ns = 1.0, 0.0, -1
        self.now_ns = 0

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        self._commands.append((self.now_ns + self._dead_time_ns, left_m_s, right_m_s))

    def break_sensor(self, sensor: str, fault: str) -> None:
        if sensor == "gyro":
            self._gyro_scale = {"stuck": 0.0, "wrong sign": -1.0}.get(fault, 1.0)
            self._drift = DRIFTS_RAD_S.get(fault, 0.0)
            self._wrong_until_ns = self.now_ns + REPORT_NS if fault == "one wrong report" else -1
            return
        for side in {"left": (0,), "right": (1,), "both": (0, 1)}[sensor]:
            self._scales[side] = {"double": 2.0, "backwards": -1.0}.get(fault, 0.0)
            if fault == "dead":
                self._counted[side] = 0.0

    def advance(self, dt_ns: int) -> None:
        self.now_ns += dt_ns
        dt_s = dt_ns * 1e-9
        while self._commands and self._commands[0][0] <= self.now_ns:
            self._wanted = self._commands.popleft()[1:]
        rolled = []
        for side in (0, 1):
            if self.now_ns % (100 * MS) < dt_ns:
                self._slipping[side] = 1.0 - self._slip * self._rng.random()
            self._speeds[side] += (self._wanted[side] - self._speeds[side]) * dt_s / LAG_S
            self._counted[side] += self._scales[side] * self._speeds[side] * dt_s
            rolled.append(self._slipping[side] * self._speeds[side] * dt_s)
        turn = (rolled[1] - rolled[0]) / self.wheel_base_m
        self.truth.advance(0.5 * (rolled[0] + rolled[1]), turn)
        self._rate = self._gyro_scale * turn / dt_s + self._drift
        self._gyro_rad += self._rate * dt_s

    def read(self) -> PlantState:
        wrong = self.now_ns < self._wrong_until_ns
        heading, rate = (self._gyro_rad + 3.0, 148.0) if wrong else (self._gyro_rad, self._rate)
        return PlantState(*self._counted, heading, rate, self.hazards)


class Outcome(NamedTuple):
    """told_s: from the fault until it is told, None if never; words: what is told first. stood_s: until the wheels are
    told to stand, None if they are not. jump_m, jump_rad: the worst step of the pose beyond the true one.
    trusted: readings that are trusted from then on until the end, of all; wrong_rad: error of the heading since."""

    told_s: float | None
    words: str
    stood_s: float | None
    jump_m: float
    jump_rad: float
    trusted: float
    wrong_rad: float


class Drive:
    """A base with mux and driver; ``twist`` is commanded at every report. times_ns of readings are those of the
    wire."""

    def __init__(self, kind: str, monkeypatch, plant: SlippingWheels) -> None:
        self.plant, self.twist = plant, (0.0, 0.0)
        self.supervisor = Supervisor(SpeedLimits())
        self.wire = Wire(kind, monkeypatch, plant, self._on_reading)
        self.heard: list[tuple] = []

    def serve(self, seconds: float) -> None:
        self.wire.serve(seconds)

    def _on_reading(self, reading) -> None:
        now_ns = self.wire.now_ns
        self.supervisor.command("navi", *self.twist, now_ns)
        decision = self.supervisor.decide(now_ns, reading.hazards)
        self.supervisor.observe(reading.odometry.fault)
        self.wire.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)
        p = self.plant.truth
        self.heard.append((now_ns, reading, decision, (p.x_m, p.y_m, p.heading_rad)))


def drive_and_break(kind: str, motion: str, sensor: str, fault: str, monkeypatch, then: str = "") -> Outcome:
    """Stand 1.5 s, drive 5 s, break the sensor, and go on for 4 s. then: the motion that begins as the sensor
    breaks."""
    plant = SlippingWheels(kind)
    drive = Drive(kind, monkeypatch, plant)
    begin_ns = 1000 * MS

    def each_ms() -> None:
        since_ns = drive.wire.now_ns - begin_ns
        if since_ns == 1500 * MS:
            drive.twist = MOTIONS[motion]
        elif since_ns == 6610 * MS:
            plant.break_sensor(sensor, fault)
            drive.twist = MOTIONS[then or motion]
            drive.wire.board.gyro_stands = (sensor, fault) == ("gyro", "stuck")

    drive.wire.each_ms = each_ms
    drive.serve(10.6)
    return outcome(drive.heard, begin_ns + 6610 * MS)


def alarms(kind: str, minutes: float, monkeypatch, seed: int = 0, **wheels) -> list[str]:
    """What is told on a drive on which nothing is broken: straights, arcs, spot turns, reversing, creeping and
    standing, each for 0.3 to 6 s, begun and ended at once as no follower would."""
    rng = random.Random(seed)
    drive = Drive(kind, monkeypatch, SlippingWheels(kind, seed, **wheels))
    next_ns = 3000 * MS

    def each_ms() -> None:
        nonlocal next_ns
        if drive.wire.now_ns >= next_ns:
            next_ns += rng.randrange(300, 6000) * MS
            v, omega = rng.uniform(-0.1, 0.4), rng.uniform(-0.8, 0.8)
            shapes = [(v, 0.0), (v, omega), (0.0, omega), (0.1 * v, 0.1 * omega), (0.0, 0.0)]
            drive.twist = rng.choice(shapes)

    drive.wire.each_ms = each_ms
    drive.serve(60.0 * minutes)
    told, last = [], ""
    for time_ns, reading, decision, _ in drive.heard:
        now = reading.odometry.doubt or decision.reason
        if now != last and now:
            told.append(f"{time_ns * 1e-9:.1f} s: {now}")
        last = now
    return told


def outcome(heard: list[tuple], broken_ns: int) -> Outcome:
    before = [h for h in heard if h[0] < broken_ns]
    assert not any(h[1].odometry.doubt or h[2].reason for h in before if h[0] > 3000 * MS), "told before it broke"
    after = [before[-1], *(h for h in heard if h[0] >= broken_ns)]
    told = [h for h in after if h[1].odometry.doubt]
    stood = [h for h in after if (h[2].v_m_s, h[2].omega_rad_s) == (0.0, 0.0)]
    steps = [_step_error(a, b) for a, b in zip(after, after[1:])]
    since = [h for h in after if told and h[0] >= told[0][0]]
    odometry, truth = after[-1][1].odometry, after[-1][3]
    return Outcome(
        (told[0][0] - broken_ns) * 1e-9 if told else None,
        told[0][1].odometry.doubt if told else "",
        (stood[0][0] - broken_ns) * 1e-9 if stood else None,
        max(m for m, _ in steps),
        max(rad for _, rad in steps),
        sum(h[1].odometry.trusted for h in since) / max(1, len(since)),
        odometry.heading_rad - truth[2] - (before[-1][1].odometry.heading_rad - before[-1][3][2]),
    )


def _step_error(before: tuple, after: tuple) -> tuple[float, float]:
    """How far the pose moved between two readings beyond what the base did, at most."""
    (_, a, _, true_a), (_, b, _, true_b) = before, after
    told_m = math.hypot(b.odometry.x_m - a.odometry.x_m, b.odometry.y_m - a.odometry.y_m)
    true_m = math.hypot(true_b[0] - true_a[0], true_b[1] - true_a[1])
    turned = b.odometry.heading_rad - a.odometry.heading_rad
    return abs(told_m - true_m), abs(turned - (true_b[2] - true_a[2]))
