"""The Create drivers against the emulated robots on a pseudo-terminal."""

import math
import queue
import time

import pytest
from hw_plant import FreeWheels

from vsx_hw.create.driver import create_driver
from vsx_hw.create.emulator import create_emulator
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Mode
from vsx_hw.readings import Hazard


class Rig:
    """An emulated Create with its driver; ``twist`` is commanded at every reading while it is set."""

    def __init__(self, model, port: str, driver_model=None) -> None:
        self.model = model
        self.plant = FreeWheels(model.wheel_base_m)
        self.emulator = create_emulator(model, self.plant, port, seed=4)
        self.board = self.emulator._board
        self.readings: queue.Queue = queue.Queue()
        self.twist = None
        self.driver = create_driver(driver_model or model, port, self.on_reading)

    def on_reading(self, reading) -> None:
        if self.twist is not None:
            self.driver.drive(*self.twist)
        self.readings.put(reading)

    def wait(self, condition, timeout_s=5.0):
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            try:
                reading = self.readings.get(timeout=0.1)
            except queue.Empty:
                continue
            if condition(reading):
                return reading
        pytest.fail(f"condition not met; driver says: {self.driver.status()}")


def until(condition, timeout_s=5.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


@pytest.fixture(params=[CREATE_1, CREATE_2], ids=["create", "create2"])
def rig(request, tmp_path):
    rig = Rig(request.param, str(tmp_path / "ttyCREATE"))
    with rig.emulator, rig.driver:
        rig.wait(lambda r: r.mode == "safe")
        yield rig


def test_starts_in_safe_drives_measures_and_stops_without_commands(rig):
    rig.twist = (0.2, 0.4)
    reading = rig.wait(lambda r: r.odometry.heading_rad > 0.4)
    assert reading.odometry.x_m == pytest.approx(0.5 * math.sin(0.4), abs=0.05)
    assert reading.battery.fraction == pytest.approx(0.889, abs=0.01)
    assert rig.plant.speeds == pytest.approx(
        (0.2 - 0.2 * rig.model.wheel_base_m, 0.2 + 0.2 * rig.model.wheel_base_m), abs=0.001
    )
    rig.twist = None
    assert until(lambda: rig.plant.speeds == (0.0, 0.0))
    reading = rig.wait(lambda r: not rig.readings.qsize())
    left, right = rig.plant.travel
    slack = 0.05 if rig.model is CREATE_1 else 0.004
    assert reading.odometry.heading_rad == pytest.approx((right - left) / rig.model.wheel_base_m, abs=slack)


def test_the_camera_is_fed_on_a_turtlebot_1(rig):
    assert until(lambda: rig.board.outputs == (1 if rig.model is CREATE_1 else 0))


def test_last_bytes_are_standstill_and_passive(rig):
    rig.twist = (0.2, 0.0)
    assert until(lambda: rig.plant.speeds[0] > 0.1)
    rig.driver.close()
    end = bytes((145, 0, 0, 0, 0, 128)) + (bytes((173,)) if rig.model is CREATE_2 else b"")
    assert until(lambda: bytes(rig.board.log).endswith(end), 1.0)
    assert rig.plant.speeds == (0.0, 0.0)
    assert rig.board.mode is Mode.PASSIVE


def test_a_cliff_stops_the_robot_until_it_may_reverse(rig):
    rig.twist = (0.2, 0.0)
    assert until(lambda: rig.plant.speeds[0] > 0.1)
    rig.plant.hazards = Hazard.CLIFF_LEFT
    fallen = rig.wait(lambda r: r.mode == "passive")
    assert fallen.hazards & Hazard.CLIFF_LEFT
    time.sleep(0.2)
    assert rig.plant.speeds == (0.0, 0.0)
    rig.twist = (-0.1, 0.0)
    assert until(lambda: rig.plant.speeds[0] < -0.05)


def test_a_raised_wheel_stops_the_robot_until_it_is_down(rig):
    rig.plant.hazards = Hazard.WHEEL_DROP_RIGHT
    rig.wait(lambda r: r.mode == "passive" and r.hazards & Hazard.WHEEL_DROP_RIGHT)
    rig.twist = (-0.1, 0.0)
    time.sleep(0.2)
    assert rig.board.mode is Mode.PASSIVE
    rig.plant.hazards = Hazard.NONE
    assert until(lambda: rig.plant.speeds[0] < -0.05)


def test_a_restarted_robot_is_found_again(rig):
    before = rig.wait(lambda r: True)
    rig.emulator.power_cycle()
    assert until(lambda: rig.driver.status().counters["connections"] == 2, 8.0)
    after = rig.wait(lambda r: r.mode == "safe")
    assert after.odometry.x_m == pytest.approx(before.odometry.x_m, abs=1e-6)


def test_the_wrong_model_is_named_with_both_baud_rates(tmp_path):
    rig = Rig(CREATE_1, str(tmp_path / "ttyCREATE"), CREATE_2)
    with rig.emulator, rig.driver:
        assert until(lambda: "57600" in rig.driver.status().message and "115200" in rig.driver.status().message)


def test_many_commands_disturb_no_report(rig):
    """Fifty and more a second: reports stay whole, the newest command wins."""
    refused = rig.driver.status().counters["refused_frames"]
    for k in range(200):
        rig.driver.drive(0.001 * k, 0.0)
        time.sleep(0.01)
    assert rig.plant.speeds[0] == pytest.approx(0.199, abs=0.012)
    assert rig.driver.status().counters["refused_frames"] - refused <= 1


def test_the_gyro_of_the_turtlebot_1_is_told(rig):
    rig.wait(lambda r: (r.gyro is not None) == (rig.model is CREATE_1) and r.stamp_ns > 0)
    if rig.model is CREATE_1:
        rig.twist = (0.0, 0.5)
        reading = rig.wait(lambda r: r.odometry.heading_rad > 0.4)
        assert reading.gyro.rate_rad_s == pytest.approx(0.5, abs=0.03)
