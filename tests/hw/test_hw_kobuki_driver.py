"""The Kobuki driver against the emulated base on a pseudo-terminal, and its thread against a null modem."""

import itertools
import queue
import struct
import threading
import time

import pytest
from hw_null_modem import LoopbackTransport
from hw_plant import FreeWheels, Rig
from waiting import PATIENCE_S, wait_for

from vsx_hw.base_driver import BaseDriver
from vsx_hw.bases import base_driver, base_emulator, detect_base
from vsx_hw.errors import DeviceNotFound
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.emulator import KobukiBoard
from vsx_hw.kobuki.protocol import (
    WHEEL_BASE_M,
    BaseControl,
    FrameScanner,
    encode_frame,
    get_gains_payload,
    request_versions_payload,
    sub_payloads,
    twist_of,
)
from vsx_hw.readings import Hazard
from vsx_hw.safety import Source, SpeedLimits, Supervisor
from vsx_hw.transport import SerialTransport


@pytest.fixture
def rig(tmp_path):
    rig = Rig("kobuki", str(tmp_path / "ttyKOBUKI"))
    with rig.emulator, rig.driver:
        rig.wait(lambda reading: True)
        yield rig


def test_drives_measures_and_stops_without_commands(rig):
    rig.twist = (0.2, 0.5)
    there = rig.wait(lambda r: r.odometry.heading_rad > 0.25)
    assert there.odometry.x_m == pytest.approx(0.4 * 0.2474, abs=0.02)
    assert there.odometry.y_m == pytest.approx(0.4 * 0.0311, abs=0.01)
    assert there.battery.voltage_v == pytest.approx(16.2)
    rig.twist = None
    wait_for(lambda: rig.plant.speeds == (0.0, 0.0), within_s=5.0)
    assert rig.driver.status().counters["refused_frames"] == 0


def test_close_stops_the_wheels_and_keeps_the_cameras_supply(rig):
    rig.twist = (0.2, 0.0)
    wait_for(lambda: rig.plant.speeds[0] > 0.1)
    rig.driver.close()
    wait_for(lambda: rig.plant.speeds == (0.0, 0.0), within_s=1.0)
    assert rig.emulator._board.outputs & 0xF0 == 0xF0


def test_unplug_and_replug_without_a_jump_and_without_motion(rig):
    rig.twist = (0.3, 0.0)
    before = rig.wait(lambda r: r.odometry.x_m > 0.05)
    rig.twist = None
    rig.emulator.unplug()
    wait_for(lambda: not rig.driver.status().connected)
    rig.emulator.power_cycle()
    assert rig.plant.speeds == (0.0, 0.0)
    while not rig.readings.empty():
        before = rig.readings.get()
    rig.emulator.replug()
    wait_for(lambda: rig.driver.status().connected)
    after = rig.wait(lambda r: True)
    assert after.odometry.x_m == pytest.approx(before.odometry.x_m, abs=0.02)
    assert after.odometry.gaps >= 1
    assert rig.driver.status().counters["connections"] == 2
    time.sleep(0.1)
    assert rig.plant.speeds == (0.0, 0.0)


def test_damaged_bytes_do_not_move_the_pose(rig):
    rig.emulator.drop_rate = 0.002
    rig.emulator.garbage_rate = 0.002
    wait_for(lambda: rig.driver.status().counters["skipped_bytes"] > 500)
    rig.emulator.drop_rate = rig.emulator.garbage_rate = 0.0
    reading = rig.wait(lambda r: True)
    assert reading.odometry[1:4] == (0.0, 0.0, 0.0)


def test_hazards_come_through(rig):
    rig.plant.hazards = Hazard.BUMPER_LEFT | Hazard.CLIFF_RIGHT | Hazard.WHEEL_DROP_LEFT
    rig.wait(lambda r: r.hazards == rig.plant.hazards)


def test_a_second_driver_is_refused(rig, tmp_path):
    with pytest.raises(DeviceNotFound, match="in use by another program"):
        SerialTransport(str(tmp_path / "ttyKOBUKI"), 115200)


class Bench:
    """The driver's thread on a null modem: the test is the base and sees every command byte."""

    def __init__(self) -> None:
        self.ends = queue.Queue()
        self.plant = FreeWheels(WHEEL_BASE_M)
        self.board = KobukiBoard(self.plant)
        self.time_ns = 0
        self.allowed = threading.Semaphore(0)
        self.driver = BaseDriver(KobukiDialect(), self.open, "bench", lambda reading: None)

    def open(self):
        assert self.allowed.acquire(timeout=PATIENCE_S)
        ours, theirs = LoopbackTransport.pair()
        self.ends.put(ours)
        return theirs


def test_silence_means_standing_still():
    """A base that stops reporting is told to stop although commands keep coming."""
    bench = Bench()
    bench.allowed.release()
    with bench.driver:
        end = bench.ends.get(timeout=PATIENCE_S)
        for k in range(10):
            end.write(bench.board.emit(k * 20_000_000))
            bench.driver.drive(0.2, 0.0)
            bench.board.receive(end.read(0.2), 0)
        wait_for(lambda: (bench.board.receive(end.read(0.05), 0), bench.plant.speeds[0] > 0.1)[1])

        def still_driving():
            bench.driver.drive(0.2, 0.0)
            bench.board.receive(end.read(0.05), 0)
            return bench.plant.speeds == (0.0, 0.0)

        wait_for(still_driving)
        bench.allowed.release()


def test_what_is_asked_again_and_again_is_answered_once_in_a_frame():
    board = KobukiBoard(FreeWheels(WHEEL_BASE_M))
    asking = encode_frame(request_versions_payload(), get_gains_payload())
    board.receive(asking * 20, 0)
    (payload,) = FrameScanner().feed(board.emit(20_000_000))
    kinds = [kind for kind, _ in sub_payloads(payload)]
    assert len(kinds) == len(set(kinds))
    assert {10, 11, 21} <= set(kinds)


def commands_in(data: bytes) -> list[tuple[float, float]]:
    """The twists in bytes to the base."""
    parts = [part for payload in FrameScanner().feed(data) for part in sub_payloads(payload)]
    return [twist_of(BaseControl(*struct.unpack("<hh", content))) for kind, content in parts if kind == 1]


class Stage:
    """A driver whose base is the test, with the mux before it; the driver says what it wrote."""

    def __init__(self) -> None:
        self.supervisor = Supervisor(SpeedLimits())
        self.end, theirs = LoopbackTransport.pair()
        self.board = KobukiBoard(FreeWheels(WHEEL_BASE_M))
        self.driver = BaseDriver(KobukiDialect(), lambda: theirs, "stage", self.on_reading)
        self.frames = 0

    def on_reading(self, reading) -> None:
        now_ns = time.monotonic_ns()
        decision = self.supervisor.decide(now_ns, reading.hazards)
        self.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)

    def exchange(self, v: float, omega: float) -> list[tuple[float, float]]:
        """One report of the base after a command; the answer is what it hears until then and shortly after."""
        self.supervisor.command("navi", v, omega, time.monotonic_ns())
        self.frames += 1
        self.end.write(self.board.emit(20_000_000 * self.frames))
        deadline = time.monotonic() + 0.03
        data = b""
        while (left := deadline - time.monotonic()) > 0:
            data += self.end.read(left)
        self.board.receive(data, 0)
        return commands_in(data)


def test_a_bumper_ends_the_forward_motion_with_the_next_command():
    stage = Stage()
    with stage.driver:
        wait_for(lambda: any(v > 0.1 for v, _ in stage.exchange(0.2, 0.3)))
        stage.board._plant.hazards = Hazard.BUMPER_LEFT
        commands = [command for _ in range(4) for command in stage.exchange(0.2, 0.3)]
        first_still = next(k for k, (v, _) in enumerate(commands) if v == 0.0)
        assert first_still <= 1, "one command may have been on its way"
        assert all(v == 0.0 for v, _ in commands[first_still:])
        wait_for(lambda: any(v < -0.1 for v, _ in stage.exchange(-0.2, 0.0)))


def test_an_expired_command_is_never_driven():
    stage = Stage()
    stage.supervisor = Supervisor(SpeedLimits(), (Source("navi", 5, 0.0),))
    with stage.driver:
        heard = [command for _ in range(10) for command in stage.exchange(0.2, 0.0)]
    assert len(heard) >= 5
    assert all(abs(v) < 1e-3 for v, _ in heard[1:])


def test_a_flood_of_commands_reaches_the_wire_once_a_report(rig):
    heard = []
    obey = rig.emulator._board._obey
    rig.emulator._board._obey = lambda kind, content: (
        heard.append(content) if kind == 1 else None,
        obey(kind, content),
    )
    frames = rig.driver.status().counters["frames"]
    flood = itertools.count()

    def is_flooded() -> bool:
        k = next(flood)
        rig.driver.drive(0.1 + 0.0001 * k, 0.0)
        return k >= 1000 and len(heard) >= 20

    wait_for(is_flooded, "commands on the wire", pause_s=0.001)
    wait_for(lambda: rig.plant.speeds[0] == 0.0, within_s=5.0)
    frames = rig.driver.status().counters["frames"] - frames
    assert len(heard) <= frames + 5
    speeds = [struct.unpack("<hh", content)[0] for content in heard]
    driven = [speed for speed in speeds if speed]
    assert driven == sorted(driven), "the newest command wins"


def test_a_permanent_fault_is_told_once(tmp_path, caplog):
    port = str(tmp_path / "nothing")
    with base_driver("kobuki", port, lambda reading: None):
        time.sleep(1.5)
    told = [record.getMessage() for record in caplog.records]
    assert told == [f"{port}: no such port; plug the base in, switch it on, and check the name with 'ls /dev/ttyUSB*'"]


def test_a_fault_in_the_listener_is_told_and_the_base_stopped(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)

    def fail(reading) -> None:
        driver.drive(0.2, 0.0)
        if plant.speeds[0] > 0.1:
            raise ZeroDivisionError("listener")

    driver = base_driver("kobuki", port, fail)
    with base_emulator("kobuki", plant, port), driver:
        wait_for(lambda: "ZeroDivisionError" in driver.status().message)
        wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)


def test_the_gyro_is_told(rig):
    rig.twist = (0.0, 0.5)
    turning = rig.wait(lambda r: r.gyro is not None and r.gyro.heading_rad > 0.2)
    assert turning.gyro.rate_rad_s == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("kind", ["kobuki", "create", "create2", "nobody"])
def test_a_base_is_found_by_asking(tmp_path, kind):
    port = str(tmp_path / "tty")
    plant = FreeWheels(WHEEL_BASE_M)
    emulator = base_emulator("kobuki" if kind == "nobody" else kind, plant, port)
    emulator.paused = kind == "nobody"
    with emulator:
        if kind == "nobody":
            with pytest.raises(DeviceNotFound, match="57600"):
                detect_base(port)
        else:
            assert detect_base(port) == kind
    assert plant.travel == [0.0, 0.0]
