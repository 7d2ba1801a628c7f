"""Nodes without a master: what one publishes is heard at once by who subscribed, and time passes when they sleep."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import actionlib
import numpy as np
import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from driving import FRAME_NS, PLAN_MS, POSE_LATE_NS, LaggingBase
from geometry_msgs.msg import Twist
from std_msgs.msg import String

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import VelocityCommand
from vsx_ros.ros import convert, dock_hold, driving, headers, planning_thread, situation, slam_messages, threads, topics
from vsx_ros.ros.logs import Diagnostics
from vsx_ros.ros.nodes import follower, move_base
from vsx_ros.slam.state import TrackingState

BEGIN_NS = 10**18
_STEP_NS, _ODOMETRY_NS = 5_000_000, 20_000_000


class OverError(Exception):
    """The time of a scene is over."""


class Wires:
    """A base with a camera at the end of all wires.

    told: every command. said: every message of each topic. services: by name. deaf: topics that nobody hears. camera,
    ahead_ns: whether images come, and how much the clock of the odometry is ahead.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.base = LaggingBase()
        self.base.now_ns = BEGIN_NS
        self.state, self.camera, self.ahead_ns, self.until_ns = TrackingState.GOOD, True, 0, 2 * BEGIN_NS
        self.told: list[VelocityCommand] = []
        self.said: dict[str, list[Any]] = defaultdict(list)
        self.services: dict[str, Callable[[Any], Any]] = {}
        self.deaf = set[str]()
        self.at_each_step: Callable[[], None] = lambda: None
        self._heard: dict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self._periodic: list[list[Any]] = []
        self._later: list[tuple[int, Callable[[], None]]] = []
        self._seen: deque[tuple[int, SE2]] = deque()
        self._next_odometry_ns = self._next_frame_ns = 0
        self.server = ActionServer(self.go_on)
        self._heard[topics.MOVE_BASE_CANCEL].append(lambda _: self.server.cancel())
        for owner, name, fake in (
            (rospy, "Publisher", self._publisher),
            (rospy, "Service", lambda name, _, answer: self.services.update({name: answer})),
            (rospy, "Subscriber", self._subscribe),
            (rospy, "get_param", lambda _, default=None: default),
            (rospy, "logerr", self._log_error),
            (threads, "every", lambda period_s, _, step: self._periodic.append([round(1e9 * period_s), 0, step])),
            (threads, "worker", lambda *_: None),
            (headers, "now_ns", lambda: self.base.now_ns),
            (Diagnostics, "__init__", lambda _: None),
            (Diagnostics, "set", lambda *_, **__: None),
            (planning_thread, "serve_adjustable", lambda *_: None),
            (planning_thread.PlanningThread, "ask", lambda planner, request: self._ask(planner, request)),
            (actionlib, "SimpleActionServer", self.server.made),
        ):
            monkeypatch.setattr(owner, name, fake)
        time = SimpleNamespace(monotonic=lambda: 1e-9 * self.base.now_ns, sleep=self.go_on)
        # others have threads, which go on
        for module in (follower, driving, move_base, situation, planning_thread, dock_hold):
            if hasattr(module, "time"):
                monkeypatch.setattr(module, "time", time)

    def _publisher(self, topic: str, kind: Any, **_: Any) -> SimpleNamespace:
        return SimpleNamespace(
            publish=lambda msg: self.say(topic, msg, kind), get_num_connections=lambda: topic not in self.deaf
        )

    def _subscribe(self, topic: str, _: Any, callback: Callable[[Any], None], **__: Any) -> None:
        self._heard[topic].append(callback)

    def _log_error(self, *_: Any) -> None:
        assert self.ahead_ns, "a node could not use a message"

    def _ask(self, planner: Any, request: Any) -> None:
        self._later.append((self.base.now_ns + round(1e6 * PLAN_MS), lambda: planner.make(request)))

    def say(self, topic: str, msg: Any, kind: Any = None) -> None:
        """Publish a message, or the value of one of this kind; a node drops and names what it cannot use."""
        msg = msg if kind is None or isinstance(msg, kind) else kind(msg)
        self.said[topic].append(msg)
        for callback in self._heard[topic]:
            callback(msg)

    def go_on(self, seconds: float) -> None:
        """Time passes: the base drives, all that comes is told, and the loops of the nodes run."""
        end_ns = self.base.now_ns + round(1e9 * seconds)
        while self.base.now_ns < end_ns:
            if self.base.now_ns >= self.until_ns:
                raise OverError
            self.base.advance(min(self.base.now_ns + _STEP_NS, end_ns))
            self.at_each_step()
            self._sense(self.base.now_ns)
            due = [make for at_ns, make in self._later if at_ns <= self.base.now_ns]
            self._later = [item for item in self._later if item[0] > self.base.now_ns]
            for make in due:
                make()
            for loop in self._periodic:
                if loop[1] <= self.base.now_ns:
                    loop[1] = max(loop[1], self.base.now_ns - loop[0]) + loop[0]
                    loop[2]()
            for msg in self.said.pop(topics.COMMAND_NAVI, []):
                assert isinstance(msg, Twist)
                self.told.append(VelocityCommand(msg.linear.x, msg.angular.z))
                self.base.tell(self.told[-1])

    def _sense(self, now_ns: int) -> None:
        if now_ns >= self._next_odometry_ns:
            self._next_odometry_ns = now_ns + _ODOMETRY_NS
            odometry = self.base.odometry._replace(stamp_ns=now_ns + self.ahead_ns)
            self.say(topics.ODOM, convert.odometry_msg(odometry, topics.ODOM_FRAME, topics.BASE_FRAME))
        if self.camera and now_ns >= self._next_frame_ns:
            self._next_frame_ns = now_ns + FRAME_NS
            self._seen.append((now_ns, self.base.pose))
        while self._seen and self._seen[0][0] + POSE_LATE_NS <= now_ns:
            stamp_ns, pose = self._seen.popleft()
            self.say(topics.FOLLOWER_LEASE, String("vslam"))
            self.say(topics.SLAM_STATE, DiagnosticStatus(name=self.state.word))
            if self.state.tracked:
                self.say(topics.POSE, slam_messages.located(stamp_ns, pose, 1e-4 * np.eye(6)))


class ActionServer:
    """A SimpleActionServer that is told its goals by the test. ended: how they ended, and what was said of it."""

    def __init__(self, sleep: Callable[[float], None]) -> None:
        self._sleep = sleep
        self.ended: list[tuple[str, str]] = []
        self._goal: Any = None
        self._cancelled = False
        self.action_server = SimpleNamespace(goal_callback=None, register_goal_callback=lambda _: None)
        self.current_goal = SimpleNamespace(get_goal_id=lambda: SimpleNamespace(id="test-1"))

    def made(self, name: str, kind: Any, execute: Callable[[Any], None], auto_start: bool) -> ActionServer:
        self._execute = execute
        return self

    def start(self) -> None:
        """Goals may come."""

    def send(self, goal: Any) -> None:
        self._goal = goal

    def cancel(self) -> None:
        self._cancelled = True

    def is_new_goal_available(self) -> bool:
        return self._goal is not None

    def is_preempt_requested(self) -> bool:
        return self._cancelled or self._goal is not None

    def publish_feedback(self, _: Any) -> None:
        """Nobody listens."""

    def set_succeeded(self, text: str) -> None:
        self.ended.append(("succeeded", text))

    def set_preempted(self, text: str) -> None:
        self.ended.append(("preempted", text))

    def set_aborted(self, text: str) -> None:
        self.ended.append(("aborted", text))

    def run(self) -> None:
        """Pursue one goal after the other, as actionlib's thread does, until the time is over."""
        while True:
            if self._goal is None:
                self._sleep(0.01)
                continue
            goal, self._goal, self._cancelled = self._goal, None, False
            self._execute(goal)
