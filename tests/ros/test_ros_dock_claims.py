"""Goals of others, held wheels and an exploration while the base docks or stands on its dock."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from std_msgs.msg import Bool
from wired_dock import CONTROL_NS, Wires, docked_by_hand, goal_comes, robot_on

from vsx_ros.config import DockingConfig
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper
from vsx_ros.ros import topics
from vsx_ros.ros.dock_claims import DockClaims


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)


RVIZ, VSX_GO, LIVE_VIEW = "/rviz_7_2-1-3.5", "/go_12_1700-1-4.5", "/dashboard-1700000000"


@pytest.mark.parametrize(("state", "identity"), [("approaching", RVIZ), ("searching", VSX_GO), ("creeping", LIVE_VIEW)])
def test_a_goal_of_somebody_else_ends_the_docking(wires, monkeypatch, state, identity):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until(state, 60.0)
    goals = robot.goals
    goal_comes(wires, identity)
    robot.until("failed", 1.0)
    assert wires.status()["reason"] == f"{identity.split('-')[0]} has sent a goal to move_base"
    assert not wires.paused, "the exploration waits for the goal by itself"
    robot.wait(3.0)
    assert (wires.status()["state"], robot.goals) == ("failed", goals), "the goal is not disturbed"
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.wait(1.0)
    assert wires.status()["state"] == "approaching", "the newer wish counts"


def test_a_goal_for_a_base_on_its_dock_leads_it_off_first_and_the_battery_waits_a_minute(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(2.0)
    robot.board.battery.fraction = 0.1
    robot.until("docked", 90.0)
    goal_comes(wires, LIVE_VIEW)
    robot.until("undocking", 0.5)
    goal_comes(wires, RVIZ)
    robot.until("undocked", 20.0)
    assert not wires.paused
    robot.wait(30.0)
    assert wires.status()["state"] == "undocked"
    robot.until("approaching", 40.0)


def test_goals_of_exploration_and_dock_and_those_before_the_docking_end_nothing(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    goal_comes(wires, "/rviz-1")
    robot.wait(0.5)
    assert wires.status()["state"] == "idle"
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    for identity in ("/dock-1-2.0", "/explore-3-4.0"):
        robot.wait(0.5)
        goal_comes(wires, identity)
    robot.until("docked", 90.0)
    goal_comes(wires, "/explore-4-5.0")
    robot.wait(1.0)
    assert wires.status()["state"] == "docked"


def test_held_wheels_keep_a_base_on_its_dock_until_they_are_let_go(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    wires.hold("teleop")
    goal_comes(wires, VSX_GO)
    robot.wait(2.0)
    assert wires.status()["state"] == "docked"
    wires.hold("")
    robot.until("undocked", 20.0)


def test_the_battery_waits_a_minute_also_for_a_goal_that_comes_on_the_way_off_the_dock(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch)
    robot.wait(2.0)
    robot.board.battery.fraction = 0.1
    robot.until("docked", 90.0)
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocking", 0.5)
    goal_comes(wires, RVIZ)
    robot.until("undocked", 20.0)
    robot.wait(30.0)
    assert wires.status()["state"] == "undocked"
    robot.until("approaching", 40.0)


@pytest.mark.parametrize("by", ["teleop", "emergency stop"])
def test_a_goal_that_led_a_base_off_its_dock_does_so_again_after_held_wheels(wires, monkeypatch, by):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    goal_comes(wires, RVIZ)
    robot.wait(1e-9 * CONTROL_NS)
    assert wires.status()["state"] == "undocking"
    wires.hold(by)
    robot.until("failed", 0.5)
    assert wires.status()["docked"]
    wires.hold("")
    robot.until("undocking", 0.5)
    robot.until("undocked", 20.0)


def test_a_goal_that_comes_while_the_contact_flickers_leads_off_the_dock_when_it_is_back(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    place, robot.plant.at_dock = robot.plant.at_dock, None
    robot.wait(0.2)
    goal_comes(wires, RVIZ)
    robot.wait(0.2)
    assert (wires.status()["state"], wires.status()["docked"]) == ("docked", False)
    robot.plant.at_dock = place
    robot.until("undocked", 20.0)


@pytest.mark.parametrize("state", list(DockingState))
def test_the_dock_holds_the_wheels_while_it_moves_the_base_and_while_that_stands_on_it(wires, state):
    docking, claims = Docking(DockingConfig(), 0), DockClaims(ChargeKeeper(DockingConfig()))
    docking.state = state
    rests_off_it = state in (DockingState.IDLE, DockingState.UNDOCKED, DockingState.FAILED)
    assert claims.holds(docking, docked=False) == (not rests_off_it and state is not DockingState.APPROACHING)
    assert claims.holds(docking, docked=True) == (state is not DockingState.APPROACHING)


def test_a_goal_is_held_until_it_has_led_a_base_that_was_docked_by_hand_off_its_dock(wires, monkeypatch):
    robot, told = docked_by_hand(wires, monkeypatch), []
    assert (wires.status()["state"], wires.status()["docked"], wires.status()["holds"]) == ("idle", True, True)
    wires._hear(topics.DOCK_STATUS, lambda msg: told.append(json.loads(msg.data)))
    wires.hold("teleop")
    goal_comes(wires, RVIZ)
    robot.wait(0.5)
    wires.hold("")
    robot.until("undocking", 0.5)
    wires.hold("teleop", 6)
    robot.until("failed", 0.5)
    robot.wait(1.5)
    assert wires.status()["docked"]
    wires.hold("")
    robot.until("undocked", 20.0)
    assert {status["holds"] for status in told if status["state"] != "undocked"} == {True}
    assert not wires.status()["holds"]


@pytest.mark.parametrize("state", ["starting", "mapping", "recovering"])
def test_an_exploration_that_drives_leaves_the_dock_first_and_again_after_held_wheels(wires, monkeypatch, state):
    robot = docked_by_hand(wires, monkeypatch)
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": state, "paused_by": []}))
    robot.until("undocking", 1.5)
    assert wires.paused
    wires.hold("teleop")
    robot.until("failed", 0.5)
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": "held", "paused_by": []}))
    robot.wait(2.5)
    assert (wires.status()["state"], wires.status()["docked"]) == ("failed", True)
    wires.hold("")
    wires.silent = False
    wires.explore(paused=False)
    robot.until("undocked", 20.0)
    robot.wait(2.5)
    assert (wires.status()["state"], wires.status()["holds"], wires.paused) == ("undocked", False, False)


def test_a_paused_exploration_does_not_lead_the_base_off_its_dock(wires, monkeypatch):
    robot = docked_by_hand(wires, monkeypatch)
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": "paused", "paused_by": ["the operator"]}))
    robot.wait(2.5)
    assert (wires.status()["state"], wires.status()["docked"]) == ("idle", True)


def test_a_base_whose_contacts_do_not_open_drives_back_once_and_explores_on(wires, monkeypatch):
    robot = docked_by_hand(wires, monkeypatch)
    wires.silent = False
    wires.explore(paused=False)
    say = wires.say
    monkeypatch.setattr(wires, "say", lambda topic, msg: say(topic, Bool(True) if topic == topics.DOCKED else msg))
    robot.until("failed", 20.0)
    assert "the contacts still touch" in wires.status()["reason"]
    robot.wait(4.0)
    assert (wires.status()["state"], wires.status()["holds"], wires.paused) == ("failed", False, False)
    assert robot.states_seen.count("undocking") == 1


def test_a_contact_on_the_way_of_a_goal_does_not_hold_it_for_ever(wires, monkeypatch):
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    goal_comes(wires, RVIZ)
    wires.silent = True
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": "user goal", "paused_by": []}))
    robot.wait(0.1)
    say = wires.say
    monkeypatch.setattr(wires, "say", lambda topic, msg: say(topic, Bool(True) if topic == topics.DOCKED else msg))
    robot.wait(0.5)
    assert (wires.status()["state"], wires.status()["docked"], wires.status()["holds"]) == ("idle", True, False)
    wires.hold("teleop")
    robot.wait(0.1)
    wires.hold("")
    robot.until("undocking", 0.2)
