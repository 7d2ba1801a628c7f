"""The drivers of Create and Create 2 against robots written from the manuals alone, over a pseudo-terminal."""

import math
import time
from statistics import median

import pytest
from documented_line import Line
from documented_oi import OFF, PASSIVE, SAFE, OpenInterface
from driven_create import CREATE_1, CREATE_2, KIND, both, driven, drives
from driving_host import Host
from waiting import Lateness, wait_for

from vsx_hw.bases import detect_base
from vsx_hw.readings import Hazard


def _off_by(host: Host) -> tuple[float, float]:
    body, odometry = host.line.robot.body, host.last.odometry
    return math.hypot(odometry.x_m - body.x_m, odometry.y_m - body.y_m), abs(odometry.heading_rad - body.yaw_rad)


def _drive_a_figure(host: Host, readings: int) -> None:
    """Line, arcs to both sides, spot turns, in reverse; each until the body has done it, then so many readings."""
    body = host.line.robot.body
    for leg in [(0.3, 0.0), (0.2, 1.0), (0.2, -1.0), (0.0, 1.2), (0.0, -1.2), (-0.2, -0.8), (-0.3, 0.0)]:
        start = (body.left_m, body.right_m)
        host.want = leg
        wait_for(lambda: abs(body.left_m - start[0]) + abs(body.right_m - start[1]) > 0.12, f"the leg {leg}")  # noqa: B023 (called at once)
    host.settle(readings)


def test_create_2_measures_a_figure_by_its_encoders(tmp_path):
    robot = OpenInterface(CREATE_2, (3, 2, 6), header_in_checksum=False, left_ticks=65500, right_ticks=20)
    with driven(tmp_path, robot) as host:
        _drive_a_figure(host, 10)
        way_m, turn_rad = _off_by(host)
        assert way_m < 0.004
        assert turn_rad < 0.004
        assert (host.last.odometry.gaps, host.last.odometry.doubt, host.last.odometry.trusted) == (0, "", True)


def test_create_1_measures_a_figure(tmp_path):
    with driven(tmp_path, OpenInterface(CREATE_1)) as host:
        _drive_a_figure(host, 30)  # distance and angle are read each half second
        way_m, turn_rad = _off_by(host)
        assert turn_rad < 0.20  # up to a degree is lost with each reading
        assert way_m < 0.08
        assert host.last.odometry.gaps == 0
        assert host.last.gyro is None


def test_create_1_turns_by_the_gyro_of_the_power_board(tmp_path):
    with driven(tmp_path, OpenInterface(CREATE_1, board_gyro_zero=500)) as host:
        wait_for(lambda: host.last.gyro is not None, "the gyro's zero, learned while standing")
        host.want = (0.0, 1.2)
        wait_for(lambda: abs(host.line.robot.body.yaw_rad) > 0.8, "the turn")
        host.settle(30)
        stamps_s = [reading.stamp_ns * 1e-9 for reading in host.readings]
        longest_s = max(after - before for before, after in zip(stamps_s, stamps_s[1:]))
        assert _off_by(host)[1] < 0.02 + 2.4 * longest_s  # the rate is known at the answers only


@both
def test_speed_and_turn_reach_the_wheels(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        for want in ((0.25, 0.0), (0.15, 0.6), (0.15, -0.6), (0.0, 1.0), (-0.2, 0.0)):
            drives(host, want)
            host.wait_readings(25)
            told = [reading.odometry for reading in list(host.readings)[-20:]]  # by arrival: one may be late
            assert median(odometry.v_m_s for odometry in told) == pytest.approx(want[0], abs=0.03)
            assert median(odometry.omega_rad_s for odometry in told) == pytest.approx(want[1], abs=0.1)


@both
@pytest.mark.parametrize("before", [[], [128], [128, 131], [128, 132]], ids=["off", "passive", "safe", "full"])
def test_it_starts_from_every_mode(tmp_path, generation, before):
    robot = OpenInterface(generation)
    for step, opcode in enumerate(before):
        robot.receive(bytes([opcode]), 0.05 * (step + 1))
    robot.advance(1.0)
    with driven(tmp_path, robot) as host:
        wait_for(lambda: host.last.mode == "safe", "Safe mode told")
        assert robot.mode == SAFE
        drives(host)


@both
def test_wheels_stand_when_nobody_commands(tmp_path, generation):
    robot, lateness = OpenInterface(generation), Lateness()
    with driven(tmp_path, robot) as host:
        drives(host)
        host.talks = False
        since_s, began_s = robot.now_s, time.monotonic()
        wait_for(lambda: robot.body.speed_m_s == 0.0, "standstill")
        sent = [(when, data) for when, opcode, data in robot.commands if opcode == 145]
        assert max(when for when, data in sent if any(data)) - since_s < 0.6 + lateness.since(began_s)
        host.wait_readings(10)
        assert robot.body.speed_m_s == 0.0


@both
def test_emergency_stop_holds_until_it_is_cleared(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        drives(host)
        host.supervisor.emergency_stop(True)
        wait_for(lambda: host.line.robot.body.speed_m_s == 0.0, "standstill")
        host.wait_readings(20)
        assert host.line.robot.body.speed_m_s == 0.0
        host.supervisor.emergency_stop(False)
        drives(host)


_CONTACTS = [
    ("bumps_and_drops", 0b01, Hazard.BUMPER_RIGHT),
    ("bumps_and_drops", 0b10, Hazard.BUMPER_LEFT),
    ("cliffs", (1, 0, 0, 0), Hazard.CLIFF_LEFT),
    ("cliffs", (0, 1, 0, 0), Hazard.CLIFF_CENTER),
    ("cliffs", (0, 0, 1, 0), Hazard.CLIFF_CENTER),
    ("cliffs", (0, 0, 0, 1), Hazard.CLIFF_RIGHT),
    ("bumps_and_drops", 0b00100, Hazard.WHEEL_DROP_RIGHT),
    ("bumps_and_drops", 0b01000, Hazard.WHEEL_DROP_LEFT),
    ("bumps_and_drops", 0b10000, Hazard.WHEEL_DROP),
]


@both
def test_each_contact_is_told_and_stops_the_forward_motion(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        robot = host.line.robot
        for field, value, hazard in _CONTACTS:
            drives(host)
            with host.line.held():
                setattr(robot, field, value)
            wait_for(lambda: robot.body.speed_m_s == 0.0, f"standstill at {hazard}")  # noqa: B023 (called at once)
            wait_for(lambda: host.last.hazards == hazard, f"{hazard} told")  # noqa: B023 (called at once)
            host.wait_readings(5)
            assert robot.body.speed_m_s == 0.0
            assert host.last.mode == ("safe" if hazard & Hazard.BUMPER else "passive")
            with host.line.held():
                setattr(robot, field, (0, 0, 0, 0) if field == "cliffs" else 0)
            host.want = (0.0, 0.0)
            wait_for(lambda: host.last.hazards == Hazard.NONE, "no contact told")


@both
def test_unplugged_and_plugged_in_again_it_waits_for_a_new_command(tmp_path, generation):
    robot = OpenInterface(generation)
    with driven(tmp_path, robot) as host:
        drives(host)
        host.talks = False
        host.line.unplug()
        wait_for(lambda: host.links[-1][0] is False, "the loss told")
        with host.line.held():
            robot.power_cycle()
            robot.left_ticks = 30000
        before = host.last.odometry
        host.line.plug()
        wait_for(lambda: host.links[-1][0], "connected again")
        host.wait_readings(10)
        after = host.last.odometry
        assert math.hypot(after.x_m - before.x_m, after.y_m - before.y_m) < 1e-3
        assert after.gaps > before.gaps
        assert robot.body.speed_m_s == 0.0
        host.talks = True
        drives(host)


def test_a_robot_that_was_switched_off_and_on_is_started_again(tmp_path):
    robot = OpenInterface(CREATE_1)
    with driven(tmp_path, robot) as host:
        drives(host)
        with host.line.held():
            robot.power_cycle()
        wait_for(lambda: host.links[-1][0] is False, "the loss told")
        wait_for(lambda: host.links[-1][0], "connected again")
        drives(host)


@both
def test_damaged_bytes_are_neither_motion_nor_contact(tmp_path, generation):
    robot = OpenInterface(generation, carries_residue=True)
    with driven(tmp_path, robot, garbage=400) as host:
        host.want = (0.2, 0.0)
        wait_for(lambda: robot.body.x_m > 0.3, "the way")
        host.settle(30)
        assert host.driver.status().counters["refused_frames"] > 0
        assert all(15.5 < reading.battery.voltage_v < 16.5 for reading in host.readings)
        odometry = host.last.odometry
        assert odometry.x_m == pytest.approx(robot.body.x_m, abs=0.02) or odometry.gaps > 0
        assert abs(odometry.heading_rad) < 0.05


@both
def test_last_bytes_are_standstill_and_a_mode_that_charges(tmp_path, generation):
    robot = OpenInterface(generation)
    with Line(robot, str(tmp_path / "create")) as line:
        with Host(KIND[generation], line) as host:
            host.connected()
            drives(host)
        wait_for(lambda: robot.mode in (OFF, PASSIVE), "the mode after the driver")
        assert line.last_bytes.endswith(bytes([145, 0, 0, 0, 0, 128] + [173] * (generation is CREATE_2)))
    assert robot.violations == []


@both
def test_it_is_found_by_asking_and_not_moved(tmp_path, generation):
    robot = OpenInterface(generation)
    with Line(robot, str(tmp_path / "create")) as line:
        assert detect_base(line.link) == KIND[generation]
    assert robot.mode == PASSIVE
    assert not {opcode for _, opcode, _ in robot.commands} & {131, 132, 137, 145, 146}
    assert robot.violations == []
