"""A Create that falls to Passive and comes back, against robots written from the manuals alone.

In Passive the robot ignores its actuators; within 20 ms of the command Safe it loses bytes, or takes the rest of a
command for another one ("Hacking Roomba" p. 45); Safe begins with all lamps off.
"""

import pytest
from documented_oi import FULL, PASSIVE, SAFE, OpenInterface
from driven_create import CREATE_1, both, driven, drives
from waiting import wait_for


@both
def test_it_backs_off_from_a_cliff_and_a_bumper_but_not_with_a_wheel_in_the_air(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        robot = host.line.robot
        for field, value, may in (
            ("cliffs", (0, 1, 0, 0), True),
            ("bumps_and_drops", 1, True),
            ("bumps_and_drops", 4, False),
        ):
            drives(host)
            with host.line.held():
                setattr(robot, field, value)
            wait_for(lambda: robot.body.speed_m_s == 0.0, "standstill")
            if may:
                drives(host, (-0.1, 0.0))
            else:
                host.want = (-0.1, 0.0)
                host.wait_readings(40)
                assert (robot.mode, robot.body.speed_m_s) == (PASSIVE, 0.0)
            with host.line.held():
                setattr(robot, field, (0, 0, 0, 0) if field == "cliffs" else 0)
            host.want = (0.0, 0.0)
            host.wait_readings(5)


@both
def test_plugged_into_the_charger_it_falls_to_passive_and_charges(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        robot = host.line.robot
        drives(host)
        with host.line.held():
            robot.charging_sources = 2
        wait_for(lambda: host.last.mode == "passive", "Passive told")
        host.want = (0.0, 0.0)
        host.wait_readings(5)
        assert robot.body.speed_m_s == 0.0
        assert (host.last.battery.state, host.last.battery.charging, host.last.battery.docked) == (
            "charging",
            True,
            True,
        )
        assert host.last.battery.voltage_v == pytest.approx(16.0)
        assert host.last.battery.fraction == pytest.approx(2000 / 2700, abs=1e-6)
        with host.line.held():
            robot.charging_sources, robot.charge_mah = 0, 250
        drives(host)
        assert (host.last.battery.state, host.last.battery.charging, host.last.battery.docked) == (
            "critical",
            False,
            False,
        )


@both
def test_it_leaves_the_dock_backwards_in_full_and_is_in_safe_again_behind_it(tmp_path, generation):
    with driven(tmp_path, OpenInterface(generation)) as host:
        robot = host.line.robot
        wait_for(lambda: robot.mode == SAFE, "Safe")
        with host.line.held():
            robot.charging_sources = 2
        wait_for(lambda: host.last.battery.charging, "charging")
        host.want = (0.0, 0.5)
        host.wait_readings(40)
        assert (robot.mode, robot.body.rate_rad_s) == (PASSIVE, 0.0), "it stands, whatever else is wanted"
        drives(host, (-0.1, 0.0))
        assert robot.mode == FULL
        with host.line.held():
            robot.charging_sources = 0
        wait_for(lambda: robot.mode == SAFE, "Safe")
        drives(host, (0.0, 0.5))


def test_the_cameras_supply_of_a_turtlebot_1_comes_back_with_safe_mode(tmp_path):
    robot = OpenInterface(CREATE_1)
    with driven(tmp_path, robot) as host:
        wait_for(lambda: robot.digital_outputs == 1, "the camera's supply")
        drives(host)
        with host.line.held():
            robot.cliffs = (1, 0, 0, 0)
        wait_for(lambda: robot.mode == PASSIVE, "Passive")
        assert robot.digital_outputs == 0
        with host.line.held():
            robot.cliffs = (0, 0, 0, 0)
        drives(host)
        wait_for(lambda: robot.digital_outputs == 1, "the camera's supply again")
        assert all(data == b"\x01" for _, opcode, data in robot.commands if opcode == 147)


@both
def test_another_programs_stream_does_not_disturb(tmp_path, generation):
    """A program that was killed leaves its stream running: the driver ends or replaces it."""
    robot = OpenInterface(generation)
    robot.receive(b"\x80", 0.1)
    robot.receive(bytes([148, 2, 6, 33]), 0.2)
    robot.advance(1.0)
    with driven(tmp_path, robot) as host:
        host.wait_readings(20)
        drives(host)
        assert host.last.battery.voltage_v == pytest.approx(16.0)


@both
def test_the_lamp_tells_the_state_and_comes_back_with_safe_mode(tmp_path, generation):
    """Safe mode begins with all lamps off: what shall be seen must be told again."""
    robot = OpenInterface(generation)
    with driven(tmp_path, robot) as host:
        wait_for(lambda: robot.lamps == (0, 0, 255), "the green lamp")
        drives(host)
        with host.line.held():
            robot.cliffs = (1, 0, 0, 0)
        wait_for(lambda: robot.mode == PASSIVE, "Passive")
        with host.line.held():
            robot.cliffs = (0, 0, 0, 0)
        drives(host)
        host.wait_readings(40)
        assert robot.lamps == (0, 0, 255)
        host.supervisor.emergency_stop(True)
        wait_for(lambda: robot.lamps == (0, 255, 255), "the red lamp")
        assert any(opcode == 141 for _, opcode, _ in robot.commands)


@both
def test_nothing_is_commanded_in_vain(tmp_path, generation):
    """In Passive neither lamps nor supplies nor songs obey: they are told when the robot listens again."""
    robot = OpenInterface(generation)
    with driven(tmp_path, robot) as host:
        drives(host)
        with host.line.held():
            robot.bumps_and_drops = 4
        wait_for(lambda: robot.mode == PASSIVE, "Passive")
        host.wait_readings(60)
        host.want = (0.0, 0.0)
        with host.line.held():
            robot.bumps_and_drops = 0
        host.wait_readings(10)
    assert not robot.ignored, f"{len(robot.ignored)}: {sorted(set(robot.ignored))}"
