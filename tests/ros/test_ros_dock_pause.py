"""The exploration pauses while the base docks, and not a moment longer."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from wired_dock import CONTROL_NS, WiredRobot, Wires, docked_by_hand, goal_comes, robot_on

from vsx_ros.ros import calls, topics


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)


def wired(monkeypatch: pytest.MonkeyPatch, wires: Wires, **docking_options: object) -> WiredRobot:
    robot = robot_on(wires, monkeypatch, **docking_options)
    robot.wait(0.5)
    return robot


@pytest.mark.parametrize("by", ["teleop", "emergency stop"])
def test_held_wheels_refuse_dock_and_undock_and_pause_nothing(wires, monkeypatch, by):
    robot = wired(monkeypatch, wires, return_to_charge=False)
    wires.hold(by)
    answer = wires.served[topics.DOCK_START](SimpleNamespace(load_namespace='{"at": [1, 0, 0]}'))
    assert not answer.success
    assert answer.message.startswith(f"the operator holds the wheels ({by}); ")
    assert answer.message.endswith(", then ask again")
    robot.wait(2.5)
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert wires.status()["state"] == "idle"
    wires.hold("")
    robot.wait(2.5)
    assert (wires.status()["state"], wires.paused) == ("idle", False)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    wires.hold(by)
    answer = wires.served[topics.DOCK_LEAVE](None)
    assert not answer.success
    assert f"({by})" in answer.message
    robot.wait(2.5)
    assert (wires.status()["state"], wires.paused) == ("docked", True)
    wires.hold("")
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocked", 20.0)


ENDS = {
    "held": lambda wires: wires.hold("teleop"),
    "cancelled": lambda wires: wires.served[topics.DOCK_CANCEL](None),
    "a goal": lambda wires: goal_comes(wires, f"/rviz-{len(wires.asked)}"),
}


@pytest.mark.parametrize("end", list(ENDS))
def test_a_docking_that_ends_before_the_loop_sees_it_pauses_nothing_for_ever(wires, monkeypatch, end):
    robot = wired(monkeypatch, wires, return_to_charge=False)
    for _ in range(2):
        assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
        assert wires.paused
        ENDS[end](wires)
        robot.wait(2.0e-9 * CONTROL_NS)
        assert (wires.status()["state"], wires.paused) == ("failed", False)
        wires.hold("")
        robot.wait(2.5)
        assert (wires.status()["state"], wires.paused) == ("failed", False)
    assert robot.states_seen == ["idle", "failed"]


def test_a_departure_that_ends_before_the_loop_sees_it_lets_the_exploration_go_on(wires, monkeypatch):
    robot = wired(monkeypatch, wires, return_to_charge=False)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    assert wires.served[topics.DOCK_LEAVE](None).success
    assert wires.served[topics.DOCK_CANCEL](None).success
    robot.until("failed", 0.5)
    robot.until("undocked", 20.0)
    robot.wait(2.5)
    assert not wires.paused


def test_held_wheels_do_not_leave_an_exploration_paused_that_is_to_leave_the_dock(wires, monkeypatch):
    robot, ask = docked_by_hand(wires, monkeypatch), wires._ask
    wires.silent = False

    def held_meanwhile(service, *words, within_s):
        answer = ask(service, *words, within_s=within_s)
        if service == topics.EXPLORE_PAUSE:
            wires.hold("teleop")
        return answer

    monkeypatch.setattr(calls, "service", held_meanwhile)
    wires.explore(paused=False)
    robot.until("failed", 2.5)
    robot.wait(2.5)
    assert (wires.status()["docked"], wires.paused) == (True, False)
    monkeypatch.setattr(calls, "service", ask)
    wires.hold("")
    robot.until("undocked", 20.0)


def test_held_wheels_keep_the_battery_from_docking_also_while_the_way_is_planned(wires, monkeypatch):
    robot, ask = wired(monkeypatch, wires), wires._ask
    robot.wait(2.0)

    def held_meanwhile(service, *words, within_s):
        if service == topics.MAKE_PLAN:
            wires.hold("teleop")
        return ask(service, *words, within_s=within_s)

    monkeypatch.setattr(calls, "service", held_meanwhile)
    robot.board.battery.fraction = 0.1
    robot.wait(10.0)
    assert topics.MAKE_PLAN in wires.asked
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert wires.status()["state"] == "idle"
    wires.hold("")
    robot.until("approaching", 2.5)


def test_a_hold_that_comes_between_errand_and_docking_pauses_nothing_and_is_told_once(wires, monkeypatch):
    robot, told = wired(monkeypatch, wires), []
    robot.wait(2.0)
    monkeypatch.setattr(rospy, "logwarn", lambda words, *values: told.append(words % values))
    due = robot.node._errands.due

    def held_meanwhile(*asked):
        errand = due(*asked)
        if errand is not None:
            wires.hold("teleop")
        return errand

    monkeypatch.setattr(robot.node._errands, "due", held_meanwhile)
    robot.board.battery.fraction = 0.1
    robot.wait(10.0)
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert len([words for words in told if "holds the wheels" in words]) == 1
    monkeypatch.setattr(robot.node._errands, "due", due)
    wires.hold("")
    robot.until("approaching", 65.0)
