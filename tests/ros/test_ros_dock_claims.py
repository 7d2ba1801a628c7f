"""Goals of others, held wheels and an exploration while the base docks or stands on its dock."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalID
from move_base_msgs.msg import MoveBaseActionGoal
from std_msgs.msg import Bool
from wired_dock import CONTROL_NS, WiredRobot, Wires, robot_on

from vsx_ros.config import Config, DockingConfig
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper
from vsx_ros.ros import calls, topics
from vsx_ros.ros.dock_claims import DockClaims
from vsx_ros.ros.nodes import dock


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)


RVIZ, VSX_GO, LIVE_VIEW = "/rviz_7_2-1-3.5", "/go_12_1700-1-4.5", "/dashboard-1700000000"


def goal_comes(wires: Wires, identity: str) -> None:
    wires.say(topics.MOVE_BASE_GOAL, MoveBaseActionGoal(goal_id=GoalID(id=identity)))


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
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 5}))
    goal_comes(wires, VSX_GO)
    robot.wait(2.0)
    assert wires.status()["state"] == "docked"
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
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
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": by, "since_ns": 5}))
    robot.until("failed", 0.5)
    assert wires.status()["docked"]
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
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


def docked_by_hand(wires: Wires, monkeypatch: pytest.MonkeyPatch) -> WiredRobot:
    """A base on its dock under a node that has just begun, without an exploration."""
    robot = robot_on(wires, monkeypatch, return_to_charge=False)
    robot.wait(0.5)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    wires.silent = True
    robot.wait(4.0)
    robot.node = dock.DockNode(Config(docking=DockingConfig(return_to_charge=False)))
    robot.until("idle", 0.5)
    robot.wait(0.5)
    return robot


def test_a_goal_is_held_until_it_has_led_a_base_that_was_docked_by_hand_off_its_dock(wires, monkeypatch):
    robot, told = docked_by_hand(wires, monkeypatch), []
    assert (wires.status()["state"], wires.status()["docked"], wires.status()["holds"]) == ("idle", True, True)
    wires._hear(topics.DOCK_STATUS, lambda msg: told.append(json.loads(msg.data)))
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 5}))
    goal_comes(wires, RVIZ)
    robot.wait(0.5)
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
    robot.until("undocking", 0.5)
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 6}))
    robot.until("failed", 0.5)
    robot.wait(1.5)
    assert wires.status()["docked"]
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
    robot.until("undocked", 20.0)
    assert {status["holds"] for status in told if status["state"] != "undocked"} == {True}
    assert not wires.status()["holds"]


@pytest.mark.parametrize("state", ["starting", "mapping", "recovering"])
def test_an_exploration_that_drives_leaves_the_dock_first_and_again_after_held_wheels(wires, monkeypatch, state):
    robot = docked_by_hand(wires, monkeypatch)
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": state, "paused_by": []}))
    robot.until("undocking", 1.5)
    assert wires.paused
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 5}))
    robot.until("failed", 0.5)
    wires.say(topics.EXPLORE_STATUS, json.dumps({"state": "held", "paused_by": []}))
    robot.wait(2.5)
    assert (wires.status()["state"], wires.status()["docked"]) == ("failed", True)
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
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
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 5}))
    robot.wait(0.1)
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
    robot.until("undocking", 0.2)


def wired(monkeypatch: pytest.MonkeyPatch, wires: Wires, **docking_options: object) -> WiredRobot:
    robot = robot_on(wires, monkeypatch, **docking_options)
    robot.wait(0.5)
    return robot


def hold(wires: Wires, by: str) -> None:
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": by, "since_ns": 5 if by else 0}))


@pytest.mark.parametrize("by", ["teleop", "emergency stop"])
def test_held_wheels_refuse_dock_and_undock_and_pause_nothing(wires, monkeypatch, by):
    robot = wired(monkeypatch, wires, return_to_charge=False)
    hold(wires, by)
    answer = wires.served[topics.DOCK_START](SimpleNamespace(load_namespace='{"at": [1, 0, 0]}'))
    assert not answer.success
    assert answer.message.startswith(f"the operator holds the wheels ({by}); ")
    assert answer.message.endswith(", then ask again")
    robot.wait(2.5)
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert wires.status()["state"] == "idle"
    hold(wires, "")
    robot.wait(2.5)
    assert (wires.status()["state"], wires.paused) == ("idle", False)
    assert wires.served[topics.DOCK_START](SimpleNamespace(load_namespace="")).success
    robot.until("docked", 90.0)
    hold(wires, by)
    answer = wires.served[topics.DOCK_LEAVE](None)
    assert not answer.success
    assert f"({by})" in answer.message
    robot.wait(2.5)
    assert (wires.status()["state"], wires.paused) == ("docked", True)
    hold(wires, "")
    assert wires.served[topics.DOCK_LEAVE](None).success
    robot.until("undocked", 20.0)


ENDS = {
    "held": lambda wires: hold(wires, "teleop"),
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
        hold(wires, "")
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
            hold(wires, "teleop")
        return answer

    monkeypatch.setattr(calls, "service", held_meanwhile)
    wires.explore(paused=False)
    robot.until("failed", 2.5)
    robot.wait(2.5)
    assert (wires.status()["docked"], wires.paused) == (True, False)
    monkeypatch.setattr(calls, "service", ask)
    hold(wires, "")
    robot.until("undocked", 20.0)


def test_held_wheels_keep_the_battery_from_docking_also_while_the_way_is_planned(wires, monkeypatch):
    robot, ask = wired(monkeypatch, wires), wires._ask
    robot.wait(2.0)

    def held_meanwhile(service, *words, within_s):
        if service == topics.MAKE_PLAN:
            hold(wires, "teleop")
        return ask(service, *words, within_s=within_s)

    monkeypatch.setattr(calls, "service", held_meanwhile)
    robot.board.battery.fraction = 0.1
    robot.wait(10.0)
    assert topics.MAKE_PLAN in wires.asked
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert wires.status()["state"] == "idle"
    hold(wires, "")
    robot.until("approaching", 2.5)


def test_a_hold_that_comes_between_errand_and_docking_pauses_nothing_and_is_told_once(wires, monkeypatch):
    robot, told = wired(monkeypatch, wires), []
    robot.wait(2.0)
    monkeypatch.setattr(rospy, "logwarn", lambda words, *values: told.append(words % values))
    due = robot.node._errands.due

    def held_meanwhile(*asked):
        errand = due(*asked)
        if errand is not None:
            hold(wires, "teleop")
        return errand

    monkeypatch.setattr(robot.node._errands, "due", held_meanwhile)
    robot.board.battery.fraction = 0.1
    robot.wait(10.0)
    assert topics.EXPLORE_PAUSE not in wires.asked
    assert len([words for words in told if "holds the wheels" in words]) == 1
    monkeypatch.setattr(robot.node._errands, "due", due)
    hold(wires, "")
    robot.until("approaching", 65.0)
