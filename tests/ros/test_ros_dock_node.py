"""The node dock: battery, user and exploration, and a node that begins anew."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from std_msgs.msg import Bool
from wired_dock import WiredRobot, Wires, robot_on

from vsx_ros.config import Config, DockingConfig
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.ros import topics
from vsx_ros.ros.nodes import dock


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)


def test_an_emptying_battery_sends_it_to_the_dock_and_a_full_one_off_it(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(2.0)
    assert wires.status()["state"] == "idle"
    assert wires.status()["battery_left_s"] > 3600
    robot.board.battery.fraction = 0.1
    robot.until("docked", 90.0)
    assert wires.asked.count(topics.EXPLORE_PAUSE) == 1
    assert topics.MAKE_PLAN in wires.asked
    robot.board.battery.pace = 1000.0
    robot.until("undocking", 60.0)
    assert robot.board.battery.fraction > 0.9
    robot.board.battery.pace = 1.0
    robot.until("undocked", 20.0)
    assert wires.asked.count(topics.EXPLORE_RESUME) == 1
    assert robot.states_seen[0] == "idle"
    assert robot.states_seen[1:5] == ["approaching", "searching", "aligning", "creeping"]
    assert robot.touches == 0


def test_a_user_docks_and_undocks_it_and_teleop_ends_a_docking(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert not wires.served[topics.DOCK_LEAVE](None).success
    started = wires.served[topics.DOCK_START](SimpleNamespace(load_namespace='{"at": [0.21, 0.0, 3.14159]}'))
    assert started.success, started.message
    robot.until("searching", 60.0)
    wires.hold("teleop")
    robot.until("failed", 1.0)
    assert "teleop" in wires.status()["reason"]
    wires.hold("")
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    assert robot.reading.battery.charging
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocked", 20.0)
    assert wires.asked.count(topics.EXPLORE_PAUSE) == wires.asked.count(topics.EXPLORE_RESUME) == 2


def test_a_robot_that_is_taken_off_its_dock_explores_on(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    robot.wait(5.0)
    assert wires.paused
    robot.plant.at_dock = None
    robot.wait(2.0)
    assert wires.paused, "the contact may come back"
    robot.wait(5.0)
    assert not wires.paused
    assert (wires.status()["state"], wires.status()["reason"]) == ("idle", "taken off the dock")


def test_a_robot_that_a_user_docks_while_the_battery_sends_it_stays_there(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(2.0)
    robot.board.battery.fraction = 0.1
    robot.until("approaching", 5.0)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    robot.board.battery.pace = 1000.0
    robot.wait(30.0)
    assert robot.board.battery.fraction > 0.95
    assert (wires.status()["state"], wires.paused) == ("docked", True)


def test_an_exploration_that_begins_on_the_dock_and_does_not_pause_ends_no_thread(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    wires.refuses = True
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": "starting", "paused_by": []}))
    wires.say(topics.DOCKED, Bool(True))
    robot.node._watch()
    assert topics.EXPLORE_PAUSE in wires.asked
    assert robot.node._docking.state is DockingState.IDLE


def test_an_exploration_that_does_not_pause_is_not_docked_under(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    wires.refuses = True
    answer = wires.served[topics.DOCK_START](SimpleNamespace(load_namespace=""))
    assert not answer.success
    assert "does not pause" in answer.message
    assert wires.status()["state"] == "idle"
    wires.silent = True
    robot.wait(4.0)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success, "it has ended"


def test_an_exploration_that_begins_anew_is_paused_again_and_a_new_dock_node_lets_it_go(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    wires.explore(paused=False)
    robot.wait(2.5)
    assert wires.paused
    robot.node = dock.DockNode(Config(docking=DockingConfig(return_to_charge=False)))
    wires.explore(paused=True)
    robot.wait(2.5)
    assert wires.paused, "it charges still"
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocked", 20.0)
    assert not wires.paused


def restarted(robot: WiredRobot) -> None:
    """Another node in place of the robot's; it hears what is latched."""
    wires = robot.wires
    robot.node = dock.DockNode(Config())
    wires.say(topics.DOCK_POSE, wires.said[topics.DOCK_POSE])
    wires.say(topics.SLAM_STATE, wires.said[topics.SLAM_STATE])
    wires.explore(wires.paused)


def test_a_node_that_is_restarted_while_it_charges_leaves_the_dock_when_charged(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(2.0)
    robot.board.battery.fraction = 0.1
    robot.until("docked", 90.0)
    restarted(robot)
    robot.until("verifying", 5.0)
    robot.until("docked", 10.0)
    assert wires.paused
    robot.board.battery.pace = 1000.0
    robot.until("undocking", 60.0)
    robot.board.battery.pace = 1.0
    robot.until("undocked", 20.0)
    assert not wires.paused
    assert robot.touches == 0


def test_a_node_that_is_restarted_on_the_way_to_the_dock_lets_the_exploration_go_on(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("searching", 60.0)
    restarted(robot)
    robot.wait(2.5)
    assert not wires.paused
    assert wires.status()["state"] == "idle"
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.wait(2.5)
    assert (wires.paused, wires.status()["state"]) == (True, "approaching")


def test_without_a_dock_or_with_nonsense_it_says_why(wires, monkeypatch):
    robot = WiredRobot(wires, monkeypatch, Config())
    robot.wait(0.2)
    for text, words in (("", "no dock is known"), ("{", "is not JSON"), ('{"at": 1}', "no place of a dock")):
        answer = wires.served[topics.DOCK_START](SimpleNamespace(load_namespace=text))
        assert not answer.success
        assert words in answer.message


def test_each_docking_has_a_number_of_its_own_and_its_end_is_told_also_the_same_again(wires, monkeypatch):
    robot, told = robot_on(wires, monkeypatch, return_to_charge=False), []
    robot.wait(0.5)
    wires._hear(topics.DOCK_STATUS, lambda msg: told.append(json.loads(msg.data)))
    first = wires.status()["number"]
    for number in (first + 1, first + 2):
        assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
        assert wires.served[topics.DOCK_CANCEL](None).success
        robot.wait(0.1)
        assert (told[-1]["state"], told[-1]["number"]) == ("failed", number)
    assert {status["state"] for status in told} == {"failed"}
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    assert wires.status()["number"] == first + 3
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocked", 20.0)
    assert wires.status()["number"] == first + 4
    robot.node = dock.DockNode(Config())
    robot.until("idle", 0.5)
    assert wires.status()["number"] not in range(first, first + 5)
