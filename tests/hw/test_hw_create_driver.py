"""The Create drivers against the emulated robots on a pseudo-terminal."""

import contextlib
import itertools
import math
import time

import pytest
from hw_plant import Rig
from waiting import wait_for

from vsx_hw.bases import BASES
from vsx_hw.create.protocol import Mode
from vsx_hw.readings import Hazard


@pytest.fixture(params=["create", "create2"])
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
        (0.2 - 0.2 * rig.plant.wheel_base_m, 0.2 + 0.2 * rig.plant.wheel_base_m), abs=0.001
    )
    rig.twist = None
    wait_for(lambda: rig.plant.speeds == (0.0, 0.0), within_s=5.0)
    left, right = rig.plant.travel
    slack = 0.05 if rig.kind == "create" else 0.004

    def headings():
        return [rig.wait(lambda r: True).odometry.heading_rad for _ in range(10)]

    wait_for(lambda: len(set(headings())) == 1, "what was measured before standstill to be read")
    reading = rig.wait(lambda r: True)
    assert reading.odometry.heading_rad == pytest.approx((right - left) / rig.plant.wheel_base_m, abs=slack)


def test_the_camera_is_fed_on_a_turtlebot_1(rig):
    wait_for(lambda: rig.board.outputs == (1 if rig.kind == "create" else 0))


def test_last_bytes_are_standstill_and_passive(rig):
    rig.twist = (0.2, 0.0)
    wait_for(lambda: rig.plant.speeds[0] > 0.1)
    rig.driver.close()
    end = bytes((145, 0, 0, 0, 0, 128)) + (bytes((173,)) if rig.kind == "create2" else b"")
    wait_for(lambda: bytes(rig.board.log).endswith(end), within_s=1.0)
    assert rig.plant.speeds == (0.0, 0.0)
    assert rig.board.mode is Mode.PASSIVE


def test_a_cliff_stops_the_robot_until_it_may_reverse(rig):
    rig.twist = (0.2, 0.0)
    wait_for(lambda: rig.plant.speeds[0] > 0.1)
    rig.plant.hazards = Hazard.CLIFF_LEFT
    fallen = rig.wait(lambda r: r.mode == "passive")
    assert fallen.hazards & Hazard.CLIFF_LEFT
    time.sleep(0.2)
    assert rig.plant.speeds == (0.0, 0.0)
    rig.twist = (-0.1, 0.0)
    wait_for(lambda: rig.plant.speeds[0] < -0.05)


def test_a_raised_wheel_stops_the_robot_until_it_is_down(rig):
    rig.plant.hazards = Hazard.WHEEL_DROP_RIGHT
    rig.wait(lambda r: r.mode == "passive" and r.hazards & Hazard.WHEEL_DROP_RIGHT)
    rig.twist = (-0.1, 0.0)
    time.sleep(0.2)
    assert rig.board.mode is Mode.PASSIVE
    rig.plant.hazards = Hazard.NONE
    wait_for(lambda: rig.plant.speeds[0] < -0.05)


def test_a_restarted_robot_is_found_again(rig):
    before = rig.wait(lambda r: True)
    rig.emulator.power_cycle()
    wait_for(lambda: rig.driver.status().counters["connections"] == 2, within_s=8.0)
    after = rig.wait(lambda r: r.mode == "safe")
    assert after.odometry.x_m == pytest.approx(before.odometry.x_m, abs=1e-6)


def test_the_wrong_kind_is_named_with_both_baud_rates(tmp_path):
    """Each of the three robots with the driver of each other one."""
    pairs = list(itertools.permutations(BASES, 2))
    rigs = [Rig(kind, str(tmp_path / f"{kind}-{believed}"), believed) for kind, believed in pairs]
    with contextlib.ExitStack() as running:
        for rig in rigs:
            running.enter_context(rig.emulator)
            running.enter_context(rig.driver)
        messages = [rig.driver.status for rig in rigs]
        wait_for(
            lambda: all("57600" in told().message and "115200" in told().message for told in messages), within_s=6.0
        )
        assert [rig.plant.travel for rig in rigs] == [[0.0, 0.0]] * 6


def test_the_gyro_of_the_turtlebot_1_is_told(rig):
    rig.wait(lambda r: (r.gyro is not None) == (rig.kind == "create") and r.stamp_ns > 0)
    if rig.kind == "create":
        rig.twist = (0.0, 0.5)
        reading = rig.wait(lambda r: r.odometry.heading_rad > 0.4)
        assert reading.gyro.rate_rad_s == pytest.approx(0.5, abs=0.03)
