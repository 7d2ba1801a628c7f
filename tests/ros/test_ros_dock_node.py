"""The node dock on an emulated base, in one process and simulated time: its topics and services are functions here."""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalID
from docking_robot import DockingRobot, Room
from geometry_msgs.msg import PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseActionGoal
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlanResponse
from std_msgs.msg import Bool, String, UInt8

from vsx_hw.readings import Hazard
from vsx_ros.config import Config, DockingConfig
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DOCK_LIGHTS
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper
from vsx_ros.robot import MAP_FRAME, STOP, VelocityCommand
from vsx_ros.ros import (
    base_messages,
    calls,
    convert,
    docking,
    driving,
    energy_messages,
    exploration_pause,
    headers,
    situation,
    threads,
    topics,
)
from vsx_ros.ros.dock_claims import DockClaims
from vsx_ros.ros.nodes import dock
from vsx_ros.slam.state import TrackingState

CONTROL_NS, BATTERY_NS, COMMAND_NS = 33_333_333, 1_000_000_000, 250_000_000
SEAT = DOCK_LIGHTS["kobuki"].seat(SE2())


class Wires:
    """Topics and services within this process. said: the last message of each topic. asked: services that the node
    called."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = lambda: 0
        self.said: dict[str, Any] = {}
        self.asked: list[str] = []
        self.paused = self.refuses = self.silent = False
        self.served: dict[str, Callable[[Any], Any]] = {}
        self.steps: dict[str, Callable[[], None]] = {}
        self._hearers: dict[str, list[Callable[[Any], None]]] = {}
        publisher = lambda topic, *_, **__: SimpleNamespace(publish=lambda msg: self.say(topic, msg))  # noqa: E731 (given on)
        monkeypatch.setattr(rospy, "Publisher", publisher)
        monkeypatch.setattr(rospy, "Subscriber", lambda topic, _, hear, *__, **___: self._hear(topic, hear))
        monkeypatch.setattr(rospy, "Service", lambda name, _, answer: self.served.update({name: answer}))
        monkeypatch.setattr(rospy, "get_param", lambda _, usual=None: usual)
        monkeypatch.setattr(rospy, "get_name", lambda: "/dock")
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(threads, "is_ending", lambda: False)
        monkeypatch.setattr(threads, "every", lambda _, name, step: self.steps.update({name: step}))
        monkeypatch.setattr(headers, "now_ns", lambda: self.now_ns())
        clock = SimpleNamespace(monotonic=lambda: 1e-9 * self.now_ns())
        for module in (situation, docking, driving, exploration_pause):
            monkeypatch.setattr(module, "time", clock)
        monkeypatch.setattr(calls, "service", self._ask)

    def _hear(self, topic: str, hear: Callable[[Any], None]) -> None:
        self._hearers.setdefault(topic, []).append(hear)

    def say(self, topic: str, msg: Any) -> None:
        self.said[topic] = msg if not isinstance(msg, str) else String(msg)
        for hear in self._hearers.get(topic, []):
            hear(self.said[topic])

    def _ask(self, service: str, *words: Any, within_s: float) -> Any:
        self.asked.append(service)
        if service == topics.MAKE_PLAN:
            start, goal = words[1:3]
            return GetPlanResponse(Path(poses=[start, goal]))
        if self.refuses:
            return SimpleNamespace(success=False)
        if service in (topics.EXPLORE_PAUSE, topics.EXPLORE_RESUME):
            self.explore(paused=service == topics.EXPLORE_PAUSE)
        return SimpleNamespace(success=True)

    def explore(self, paused: bool) -> None:
        self.paused = paused
        facts = {"state": "paused" if paused else "mapping", "paused_by": ["the dock"] * paused}
        self.say(topics.EXPLORE_STATUS, json.dumps(facts))

    def status(self) -> dict[str, Any]:
        return dict(json.loads(self.said[topics.DOCK_STATUS].data))


class WiredRobot(DockingRobot):
    """Its docking is the node's; its navigator answers the node's goals."""

    def __init__(self, wires: Wires, monkeypatch: pytest.MonkeyPatch, config: Config) -> None:
        self.wires, self.states_seen = wires, []
        self._heard_ns, self._battery_ns, self._command, self.goals = 0, 0, (0, STOP), 0
        self.node: Any = None
        super().__init__("kobuki", Room(SE2(1.5, 0.4, 2.5)), 7, config)
        wires.now_ns = lambda: self.now_ns
        goals = SimpleNamespace(
            state=lambda: (self.navigator.state, ""), cancel=lambda: None,
            send=lambda now_ns, frame, goal: self._go(now_ns, frame, goal),
        )  # fmt: skip
        monkeypatch.setattr(dock, "GoalSender", lambda: goals)
        self.node = dock.DockNode(config)
        wires._hear(topics.COMMAND_NAVI, self._on_command)
        wires.say(topics.SLAM_STATE, convert.state_msg(TrackingState.GOOD, ""))

    def _go(self, now_ns: int, frame: str, goal: SE2) -> None:
        assert frame == MAP_FRAME
        self.goals += 1
        self.navigator.go(now_ns, goal, frame)
        self.navigator.state = NavigationState.ACTIVE

    def _on_command(self, msg: Any) -> None:
        self._command = self.now_ns, VelocityCommand(msg.linear.x, msg.angular.z)

    def _docked(self, reading: Any, moved: Any, where: Any, hazard: str) -> VelocityCommand | None:
        if self.node is None:
            return STOP
        say = self.wires.say
        say(topics.ODOM, base_messages.dead_reckoning(moved))
        say(topics.DOCK_IR, energy_messages.dock_ir(reading.dock))
        say(topics.DOCKED, Bool(reading.battery.docked))
        say(topics.HAZARDS, UInt8(int(reading.hazards & Hazard.TOUCHED)))
        if where.T_map_base is not None:
            msg = PoseWithCovarianceStamped()
            msg.header = headers.header(topics.MAP_FRAME, moved.stamp_ns)
            msg.pose.pose = convert.pose_msg(where.T_map_base)
            say(topics.POSE, msg)
        if self.now_ns - self._heard_ns >= CONTROL_NS:
            self._heard_ns = self.now_ns
            self.wires.steps["docking"]()
            state = self.wires.status()["state"]
            if state not in self.states_seen[-1:]:
                self.states_seen.append(state)
        if self.now_ns - self._battery_ns >= BATTERY_NS:
            self._battery_ns = self.now_ns
            if not self.wires.silent:
                self.wires.explore(self.wires.paused)
            say(topics.BATTERY, energy_messages.battery(reading.battery, moved.stamp_ns))
            self.wires.steps["battery"]()
        sent_ns, command = self._command
        if self.states_seen[-1:] == ["approaching"]:
            return None
        return command if self.now_ns - sent_ns < COMMAND_NS else STOP

    def until(self, state: str, seconds: float) -> None:
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.states_seen[-1:] != [state]:
            assert self.now_ns < end_ns, f"waited for {state}: {self.states_seen}, {self.wires.status()}"
            self.wait(1e-9 * CONTROL_NS)


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)


def robot_on(wires: Wires, monkeypatch: pytest.MonkeyPatch, **docking_options: Any) -> WiredRobot:
    robot = WiredRobot(wires, monkeypatch, Config(docking=DockingConfig(**docking_options)))
    wires.explore(paused=False)
    wires.say(topics.DOCK_POSE, convert.pose_stamped(topics.MAP_FRAME, 1, SEAT))
    return robot


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
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "teleop", "since_ns": 5}))
    robot.until("failed", 1.0)
    assert "teleop" in wires.status()["reason"]
    wires.say(topics.OPERATOR_HOLD, json.dumps({"by": "", "since_ns": 0}))
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
