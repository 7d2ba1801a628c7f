"""Bases of the documents that are silent, say what no manual lists, or whose gyro is broken."""

import math
import re
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from documented_kobuki import GYRO_DEG_S, Kobuki
from documented_line import Line
from documented_oi import OpenInterface
from driven_create import CREATE_1, CREATE_2, both
from driven_create import driven as driven_create
from driving_host import Host
from waiting import wait_for

KINDS = {"kobuki": Kobuki, "create": lambda: OpenInterface(CREATE_1), "create2": lambda: OpenInterface(CREATE_2)}


def driven(tmp_path: Path, kind: str) -> tuple[Line, AbstractContextManager[Host]]:
    line = Line(KINDS[kind](), str(tmp_path / kind))
    return line, Host(kind, line)


@pytest.mark.parametrize("kind", KINDS)
def test_a_silent_base_stands_is_told_and_drives_again_by_itself(tmp_path, kind):
    line, host = driven(tmp_path, kind)
    with line, host:
        host.connected()
        host.want = (0.2, 0.0)
        body = line.robot.body
        wait_for(lambda: body.speed_m_s > 0.15, "driving")
        line.silent = True
        wait_for(lambda: body.speed_m_s == 0.0, "standstill")
        wait_for(lambda: re.search(r"for [01]\.\d s", host.driver.status().message), "the silence told")
        assert not host.driver.status().connected
        before, turned_after = host.count, list[int]()
        host.driver._on_command = lambda turning: turned_after.append(host.count - before) if turning else None
        line.silent = False
        wait_for(lambda: body.speed_m_s > 0.15, "driving again")
        assert turned_after[0] >= 3, "good reports in a row"


def test_a_charger_state_that_no_document_has_is_told(tmp_path):
    line, host = driven(tmp_path, "kobuki")
    with line, host:
        host.connected()
        with line.held():
            line.robot.charger = 9
        wait_for(lambda: any("charger state 9 " in told for told in host.last.warnings), "the unknown state")
        assert not host.last.battery.charging


@both
def test_a_charging_state_that_no_manual_has_is_told(tmp_path, generation, monkeypatch):
    robot = OpenInterface(generation)
    with driven_create(tmp_path, robot) as host:
        value = robot._value  # a Create 1 tells it within a group of packets
        monkeypatch.setattr(robot, "_value", lambda number: 9 if number == 21 else value(number))
        wait_for(lambda: any("charging state 9 " in told for told in host.last.warnings), "the unknown state")
        assert not host.last.battery.charging


@both
def test_a_create_in_a_mode_that_no_manual_has_stands(tmp_path, generation, monkeypatch):
    robot = OpenInterface(generation)
    with driven_create(tmp_path, robot) as host:
        host.want = (0.2, 0.0)
        wait_for(lambda: robot.body.speed_m_s > 0.15, "driving")
        packet = robot.packet
        with monkeypatch.context() as unknown:
            unknown.setattr(robot, "packet", lambda number: b"\x04" if number == 35 else packet(number))
            wait_for(lambda: "mode 4 " in host.last.refusal, "the refusal")
            wait_for(lambda: robot.body.speed_m_s == 0.0, "standstill")
        wait_for(lambda: robot.body.speed_m_s > 0.15, "driving again")


def test_the_samples_of_the_gyro_are_turned_into_the_axes_of_the_base(tmp_path):
    line, host = driven(tmp_path, "kobuki")
    with line, host:
        with line.held():
            line.robot.gyro_samples = ((42, -110, -68), (35, -104, -71))
        wait_for(lambda: host.readings and host.last.gyro.raw and host.last.gyro.raw[-1].z != 0.0, "the samples")
        expected = [
            tuple(math.radians(GYRO_DEG_S) * step for step in axes) for axes in ((110, 42, -68), (104, 35, -71))
        ]
        assert [tuple(sample)[1:] for sample in host.last.gyro.raw] == [pytest.approx(axes) for axes in expected]


@pytest.mark.parametrize("drift_deg_s", [5.0, 1.0, -1.0])
def test_a_gyro_that_drifts_at_standstill_is_told(tmp_path, drift_deg_s):
    with Line(Kobuki(gyro_drift_deg_s=drift_deg_s), str(tmp_path / "kobuki")) as line, Host("kobuki", line) as host:
        wait_for(lambda: host.readings and host.last.odometry.doubt, "the doubt")
        assert "the heading is that of the wheels" in host.last.odometry.doubt
        assert not host.last.gyro.trusted


def test_a_gyro_whose_samples_repeat_is_dead(tmp_path):
    robot = Kobuki(gyro_samples=((3, -5, 7), (2, -4, 9)))
    with Line(robot, str(tmp_path / "kobuki")) as line, Host("kobuki", line) as host:
        wait_for(lambda: host.readings and "dead" in host.last.odometry.doubt, "the dead gyro")
        assert not host.last.gyro.trusted
