"""The Kobuki driver against a Kobuki that was written from the protocol document alone, over a pseudo-terminal."""

import math
import random
import struct
import time
from contextlib import contextmanager

import pytest
from documented_body import Body
from documented_kobuki import Kobuki, wheel_speeds_m_s
from documented_line import Line
from driving_host import Host
from waiting import Lateness, wait_for

from vsx_hw.bases import BASES, detect_base
from vsx_hw.readings import Hazard, Signal

_CAMERA_SUPPLIES = 0x00F0


@contextmanager
def driven(tmp_path, robot: Kobuki, garbage: int = 0):
    """A driver on the robot; at the end the robot stands, its camera has power, and nothing forbidden was sent."""
    with Line(robot, str(tmp_path / "kobuki"), garbage) as line:
        with Host("kobuki", line) as host:
            host.connected()
            yield host
        if line._master >= 0:
            wait_for(
                lambda: robot.base_commands[-1][1:] == (0, 0) and robot.body.left_m_s == 0.0, "standstill at the end"
            )
    assert robot.violations == []
    assert all(bits & _CAMERA_SUPPLIES == _CAMERA_SUPPLIES for bits in robot.outputs if bits)


def _off_by(host: Host) -> tuple[float, float]:
    """Distance [m] and turn [rad] between where the driver thinks that the body is, and where it is."""
    body, odometry = host.line.robot.body, host.last.odometry
    return math.hypot(odometry.x_m - body.x_m, odometry.y_m - body.y_m), abs(odometry.heading_rad - body.yaw_rad)


def _drive_a_figure(host: Host, linear_m_s: float = 0.4) -> None:
    """Line, arcs to both sides, spot turns, an arc in reverse; each until the body has done it."""
    body = host.line.robot.body
    legs = [(linear_m_s, 0.0), (0.3, 1.2), (0.3, -1.2), (0.0, 2.0), (0.0, -2.0), (-0.3, -1.0), (-linear_m_s, 0.0)]
    for leg in legs:
        start = (body.left_m, body.right_m)
        host.want = leg
        wait_for(lambda: abs(body.left_m - start[0]) + abs(body.right_m - start[1]) > 0.12, f"the leg {leg}")  # noqa: B023 (called at once)
    host.settle()


@pytest.mark.parametrize(
    "changes",
    [
        {"left_ticks": 65000, "right_ticks": 300, "stamp_ms": 65000, "angle_offset_cdeg": 17900},
        {"body": Body(0.230, acceleration_m_s2=1.0), "dead_time_s": 0.2},
    ],
    ids=["counters wrap", "slow to obey"],
)
def test_a_figure_is_measured_as_it_was_driven(tmp_path, changes):
    with driven(tmp_path, Kobuki(**changes)) as host:
        _drive_a_figure(host)
        way_m, turn_rad = _off_by(host)
        assert way_m < 0.002
        assert turn_rad < 0.0005
        assert host.last.odometry.gaps == 0
        assert host.last.odometry.wheels_m == pytest.approx(
            (host.line.robot.body.left_m, host.line.robot.body.right_m), abs=2e-4
        )


def test_speeds_are_measured_as_driven_forward_and_back(tmp_path):
    with driven(tmp_path, Kobuki()) as host:
        for want in ((0.3, 0.0), (-0.2, 0.5), (0.0, -1.5)):
            host.want = want
            body = host.line.robot.body
            wait_for(lambda: (body.speed_m_s, body.rate_rad_s) == pytest.approx(want, abs=0.01), "the speed")  # noqa: B023 (called at once)
            host.wait_readings(5)  # their speeds are by the robot's own clock
            assert host.last.odometry.v_m_s == pytest.approx(body.speed_m_s, abs=0.006)
            assert host.last.odometry.omega_rad_s == pytest.approx(body.rate_rad_s, abs=0.02)
            assert host.last.gyro.rate_rad_s == pytest.approx(body.rate_rad_s, abs=0.012)


def test_every_twist_reaches_the_wheels():
    """The pair of integers on the wire turns the wheels as asked, as near as a whole millimetre of radius allows. Where
    a wheel would exceed the 0.7 m/s of the user guide, both turn slower, on the same curve."""
    rng = random.Random(3)
    robot = Kobuki()
    for step in range(2000):
        v = rng.uniform(-0.7, 0.7) if step % 7 else 0.0
        omega = rng.choice((rng.uniform(-3.1, 3.1), rng.uniform(-0.05, 0.05), 0.0))
        robot.receive(BASES["kobuki"].dialect(1.0, 1.0).drive(v, omega), step * 0.1)
        share = min(1.0, 0.7 / max(0.7, abs(v) + 0.115 * abs(omega)))
        v, omega = share * v, share * omega
        left, right = wheel_speeds_m_s(*robot.base_commands[-1][1:])
        assert (left + right) / 2 == pytest.approx(v, abs=0.001 + 0.0005 * abs(omega))
        assert (right - left) / 0.230 == pytest.approx(omega, abs=0.015)
    assert robot.violations == []


@pytest.mark.parametrize(
    "firmware", [(1, 2, 0), (1, 1, 4), (1, 1, 2), (1, 1, 1), (1, 1, 0), (1, 0, 0)], ids=lambda v: ".".join(map(str, v))
)
def test_the_version_is_asked_for_and_understood(tmp_path, firmware):
    robot = Kobuki(firmware=firmware)
    with driven(tmp_path, robot) as host:
        wait_for(lambda: robot.requests, "a request for the versions")
        host.wait_readings(3)
        assert host.driver._dialect.firmware == firmware
        host.wait_readings(30)
        assert len(robot.requests) == 1  # not again once it is known


_BITS = {"bumper": Hazard.BUMPER_RIGHT, "cliff": Hazard.CLIFF_RIGHT, "wheel_drop": Hazard.WHEEL_DROP_RIGHT}
_SIDES = [("bumper", 1), ("bumper", 2), ("bumper", 4), ("cliff", 1), ("cliff", 2), ("cliff", 4)]
_SIDES += [("wheel_drop", 1), ("wheel_drop", 2)]


def test_each_contact_is_told_and_stops_what_it_forbids(tmp_path):
    with driven(tmp_path, Kobuki()) as host:
        robot = host.line.robot
        for field, bit in _SIDES:
            host.want = (0.2, 0.0)
            wait_for(lambda: robot.body.speed_m_s == pytest.approx(0.2), "driving")
            with host.line.held():
                setattr(robot, field, bit)
            hazard = Hazard(_BITS[field] * bit)
            wait_for(lambda: host.last.hazards == hazard, f"{field} {bit} told")  # noqa: B023 (called at once)
            wait_for(lambda: robot.body.speed_m_s == 0.0, f"standstill at {field} {bit}")
            host.want = (-0.1, 0.0)
            if field != "wheel_drop":
                wait_for(lambda: robot.body.speed_m_s == pytest.approx(-0.1), f"backing off from {field} {bit}")
            else:
                host.wait_readings(6)
                assert robot.body.speed_m_s == 0.0
            with host.line.held():
                setattr(robot, field, 0)
            host.want = (0.0, 0.0)
            host.wait_readings(5)
        assert (4,) in robot.sounds  # the alarm of the wheel drop


def test_emergency_stop_holds_until_it_is_cleared(tmp_path):
    with driven(tmp_path, Kobuki()) as host:
        body = host.line.robot.body
        host.want = (0.2, 0.3)
        wait_for(lambda: body.speed_m_s > 0.1, "driving")
        host.supervisor.emergency_stop(True)
        wait_for(lambda: body.speed_m_s == 0.0, "standstill")
        before = (body.left_m, body.right_m)
        host.wait_readings(20)
        assert (body.left_m, body.right_m) == before
        host.supervisor.emergency_stop(False)
        wait_for(lambda: body.speed_m_s > 0.1, "driving again")


def test_wheels_stand_when_nobody_commands(tmp_path):
    robot, lateness = Kobuki(), Lateness()
    with driven(tmp_path, robot) as host:
        host.want = (0.3, 0.0)
        wait_for(lambda: robot.body.speed_m_s > 0.2, "driving")
        host.talks = False
        since_s, began_s = robot.now_s, time.monotonic()
        wait_for(lambda: robot.body.speed_m_s == 0.0, "standstill")
        zero_s = next(when for when, speed, _ in reversed(robot.base_commands) if speed != 0)
        assert zero_s - since_s < 0.4 + lateness.since(began_s)  # 0.25 s by the rule
        sent = len(robot.base_commands)
        host.wait_readings(20)
        assert len(robot.base_commands) > sent + 5  # standstill is repeated
        assert {speed for _, speed, _ in robot.base_commands[sent:]} == {0}


def test_battery_charger_and_buttons(tmp_path):
    states = {0: ("healthy", False, False), 2: ("charged", False, True), 6: ("charging", True, True)}
    states |= {18: ("charged", False, False), 22: ("charging", True, False)}
    with driven(tmp_path, Kobuki()) as host:
        robot = host.line.robot
        for charger, (state, charging, docked) in states.items():
            for battery, button in ((157, 1), (140, 2), (132, 4)):
                with host.line.held():
                    robot.charger, robot.battery_dv, robot.buttons = charger, battery, button
                host.wait_readings(3)
                told = host.last.battery
                expected = state if charger else {157: "healthy", 140: "low", 132: "critical"}[battery]
                assert (told.state, told.charging, told.docked) == (expected, charging, docked)
                assert told.voltage_v == pytest.approx(battery / 10)
                assert told.fraction == pytest.approx(0.05 + 0.95 * (battery / 10 - 13.2) / 3.3, abs=0.01)
                assert host.last.buttons == button


def test_unplugged_and_plugged_in_again_it_waits_for_a_new_command(tmp_path):
    robot = Kobuki(command_time_out_s=0.6)
    with driven(tmp_path, robot) as host:
        host.want = (0.2, 0.0)
        wait_for(lambda: robot.body.speed_m_s > 0.1, "driving")
        host.talks = False
        host.line.unplug()
        wait_for(lambda: host.links[-1][0] is False, "the loss told")
        wait_for(lambda: robot.body.speed_m_s == 0.0, "the base's own time-out")
        before = host.last.odometry
        with host.line.held():
            robot.power_cycle(left_ticks=31000, right_ticks=123, stamp_ms=40)
        host.line.plug()
        wait_for(lambda: host.links[-1][0], "connected again")
        host.wait_readings(10)
        after = host.last.odometry
        assert math.hypot(after.x_m - before.x_m, after.y_m - before.y_m) < 1e-6
        assert after.gaps > before.gaps
        assert robot.body.speed_m_s == 0.0
        host.talks = True
        wait_for(lambda: robot.body.speed_m_s > 0.1, "driving again")
        assert len(robot.requests) <= 2


def test_damaged_bytes_are_neither_motion_nor_contact(tmp_path):
    with driven(tmp_path, Kobuki(left_ticks=65000), garbage=300) as host:
        _drive_a_figure(host)
        way_m, turn_rad = _off_by(host)
        assert host.driver.status().counters["refused_frames"] + host.driver.status().counters["skipped_bytes"] > 0
        assert way_m < 0.02
        assert turn_rad < 0.01
        assert all(
            reading.hazards == Hazard.NONE and 15.6 < reading.battery.voltage_v < 15.8 for reading in host.readings
        )


def test_last_bytes_are_standstill_with_the_supplies_on(tmp_path):
    robot = Kobuki()
    with Line(robot, str(tmp_path / "kobuki")) as line:
        with Host("kobuki", line) as host:
            host.connected()
            host.want = (0.3, 0.0)
            wait_for(lambda: robot.body.speed_m_s > 0.2, "driving")
        wait_for(lambda: robot.body.speed_m_s == 0.0, "standstill")
        assert robot.base_commands[-1][1:] == (0, 0)
        assert robot.outputs[-1] == _CAMERA_SUPPLIES
    assert robot.violations == []


def test_it_is_found_by_listening(tmp_path):
    robot = Kobuki()
    with Line(robot, str(tmp_path / "kobuki")) as line:
        assert detect_base(line.link) == "kobuki"
    assert robot.violations == []
    assert robot.base_commands == []


def test_lamps_and_melodies_are_within_the_document():
    """Whatever the driver shows, the robot understands, and the camera keeps its supply."""
    robot, dialect = Kobuki(), BASES["kobuki"].dialect(1.0, 1.0)
    for signal, lamp in ((Signal.READY, 0x0200), (Signal.HELD, 0x0300), (Signal.ALARM, 0x0100)):
        robot.receive(dialect.show(signal), robot.now_s)
        assert robot.outputs[-1] == _CAMERA_SUPPLIES | lamp
    robot.receive(dialect.halt() + dialect.farewell(), 1.0)
    assert struct.pack("<hh", *robot.base_commands[-1][1:]) == bytes(4)
    assert robot.violations == []
