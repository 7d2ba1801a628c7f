"""The node dock on an emulated base, in one process and simulated time: its topics and services are functions here."""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
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

    def hold(self, by: str, since_ns: int = 5) -> None:
        """The operator holds the wheels; by: empty when they are let go."""
        self.say(topics.OPERATOR_HOLD, json.dumps({"by": by, "since_ns": since_ns if by else 0}))

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


def robot_on(wires: Wires, monkeypatch: pytest.MonkeyPatch, **docking_options: Any) -> WiredRobot:
    robot = WiredRobot(wires, monkeypatch, Config(docking=DockingConfig(**docking_options)))
    wires.explore(paused=False)
    wires.say(topics.DOCK_POSE, convert.pose_stamped(topics.MAP_FRAME, 1, SEAT))
    return robot


def goal_comes(wires: Wires, identity: str) -> None:
    wires.say(topics.MOVE_BASE_GOAL, MoveBaseActionGoal(goal_id=GoalID(id=identity)))


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
