"""The Kobuki driver against the emulated base on a pseudo-terminal, and its thread against a null modem."""

import queue
import threading
import time

import pytest
from hw_plant import FreeWheels

from vsx_hw.base_driver import BaseDriver
from vsx_hw.errors import DeviceNotFound
from vsx_hw.kobuki.base_control import WHEEL_BASE_M
from vsx_hw.kobuki.driver import KobukiDialect, kobuki_driver
from vsx_hw.kobuki.emulator import KobukiBoard, kobuki_emulator
from vsx_hw.readings import Hazard
from vsx_hw.transport import LoopbackTransport, SerialTransport


class Rig:
    """An emulated Kobuki with its driver; ``twist`` is commanded at every reading while it is set."""

    def __init__(self, port: str) -> None:
        self.plant = FreeWheels(WHEEL_BASE_M)
        self.emulator = kobuki_emulator(self.plant, port, seed=4)
        self.readings: queue.Queue = queue.Queue()
        self.twist = None
        self.driver = kobuki_driver(port, self.on_reading)

    def on_reading(self, reading) -> None:
        if self.twist is not None:
            self.driver.drive(*self.twist)
        self.readings.put(reading)

    def wait(self, condition, timeout_s=5.0):
        """The first reading from now on for which the condition holds."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            try:
                reading = self.readings.get(timeout=0.1)
            except queue.Empty:
                continue
            if condition(reading):
                return reading
        pytest.fail(f"condition not met; driver says: {self.driver.status()}")


@pytest.fixture
def rig(tmp_path):
    rig = Rig(str(tmp_path / "ttyKOBUKI"))
    with rig.emulator, rig.driver:
        rig.wait(lambda reading: True)
        yield rig


def until(condition, timeout_s=5.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def test_drives_measures_and_stops_without_commands(rig):
    rig.twist = (0.2, 0.5)
    there = rig.wait(lambda r: r.odometry.heading_rad > 0.25)
    assert there.odometry.x_m == pytest.approx(0.4 * 0.2474, abs=0.02)
    assert there.odometry.y_m == pytest.approx(0.4 * 0.0311, abs=0.01)
    assert there.battery.voltage_v == pytest.approx(16.2)
    rig.twist = None
    assert until(lambda: rig.plant.speeds == (0.0, 0.0))
    assert rig.driver.status().counters["refused_frames"] == 0


def test_close_stops_the_wheels_and_keeps_the_cameras_supply(rig):
    rig.twist = (0.2, 0.0)
    assert until(lambda: rig.plant.speeds[0] > 0.1)
    rig.driver.close()
    assert until(lambda: rig.plant.speeds == (0.0, 0.0), 1.0)
    assert rig.emulator._board.outputs & 0xF0 == 0xF0


def test_unplug_and_replug_without_a_jump_and_without_motion(rig):
    rig.twist = (0.3, 0.0)
    before = rig.wait(lambda r: r.odometry.x_m > 0.05)
    rig.twist = None
    rig.emulator.unplug()
    assert until(lambda: not rig.driver.status().connected)
    rig.emulator.power_cycle()
    assert rig.plant.speeds == (0.0, 0.0)
    while not rig.readings.empty():
        before = rig.readings.get()
    rig.emulator.replug()
    assert until(lambda: rig.driver.status().connected)
    after = rig.wait(lambda r: True)
    assert after.odometry.x_m == pytest.approx(before.odometry.x_m, abs=0.02)
    assert after.odometry.gaps >= 1
    assert rig.driver.status().counters["connections"] == 2
    time.sleep(0.1)
    assert rig.plant.speeds == (0.0, 0.0)


def test_damaged_bytes_do_not_move_the_pose(rig):
    rig.emulator.faults.drop_rate = 0.002
    rig.emulator.faults.garbage_rate = 0.002
    assert until(lambda: rig.driver.status().counters["skipped_bytes"] > 500)
    rig.emulator.faults.drop_rate = rig.emulator.faults.garbage_rate = 0.0
    reading = rig.wait(lambda r: True)
    assert reading.odometry[1:4] == (0.0, 0.0, 0.0)


def test_hazards_come_through(rig):
    rig.plant.hazards = Hazard.BUMPER_LEFT | Hazard.CLIFF_RIGHT | Hazard.WHEEL_DROP_LEFT
    rig.wait(lambda r: r.hazards == rig.plant.hazards)


def test_a_second_driver_is_refused(rig, tmp_path):
    with pytest.raises(DeviceNotFound, match="in use by another program"):
        SerialTransport(str(tmp_path / "ttyKOBUKI"), 115200)


def test_the_missing_port_is_named_with_the_remedy(tmp_path):
    with pytest.raises(DeviceNotFound, match="no such port; plug the base in"):
        SerialTransport(str(tmp_path / "nothing"), 115200)


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
        assert self.allowed.acquire(timeout=10.0)
        ours, theirs = LoopbackTransport.pair()
        self.ends.put(ours)
        return theirs


def test_silence_means_standing_still():
    """A base that stops reporting is told to stop although commands keep coming."""
    bench = Bench()
    bench.allowed.release()
    with bench.driver:
        end = bench.ends.get(timeout=5.0)
        for k in range(10):
            end.write(bench.board.emit(k * 20_000_000))
            bench.driver.drive(0.2, 0.0)
            bench.board.receive(end.read(0.2), 0)
        assert until(lambda: (bench.board.receive(end.read(0.05), 0), bench.plant.speeds[0] > 0.1)[1])

        def still_driving():
            bench.driver.drive(0.2, 0.0)
            bench.board.receive(end.read(0.05), 0)
            return bench.plant.speeds == (0.0, 0.0)

        assert until(still_driving)
        bench.allowed.release()


def test_versions_are_asked_for_a_bounded_number_of_times():
    dialect = KobukiDialect()
    sent = [dialect.drive(0.0, 0.0) for _ in range(2000)]
    assert sum(len(frame) > 10 for frame in sent) == 10
