"""The clock is set back while the robot explores: nothing waits until it is as late again. Without a master."""

import queue
import threading
from types import SimpleNamespace
from typing import Any

import pytest
from test_ros_blind import InARoom, euclid
from test_ros_operator_claim import exploring
from waiting import PATIENCE_S

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, NavigationState
from vsx_ros.exploration.mission import Mission
from vsx_ros.ros import driving, headers

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

SECOND = 10**9


class Clock:
    """ROS time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 10**18
        monkeypatch.setattr(headers, "now_ns", lambda: self.now_ns)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_the_time_to_wait_by_goes_on(clock: Clock) -> None:
    begun_ns = headers.timer_ns()
    clock.now_ns += SECOND
    assert headers.timer_ns() == begun_ns + SECOND
    clock.now_ns -= 3600 * SECOND
    assert headers.timer_ns() == begun_ns + SECOND
    clock.now_ns += SECOND
    assert headers.timer_ns() == begun_ns + 2 * SECOND


def test_the_mission_goes_on_after_a_failed_goal(clock: Clock) -> None:
    acts, state = list[Any](), [NavigationState.IDLE]
    node = exploring(InARoom(None), Mission(Config(), euclid), lambda: (state[0], "the way is blocked"), acts)
    node._decide()
    assert acts.pop().action is Action.GO
    state[0] = NavigationState.ABORTED
    node._decide()
    clock.now_ns -= 3600 * SECOND
    for _ in range(25):
        clock.now_ns += SECOND // 5
        node._decide()
    assert Action.GO in [decision.action for decision in acts], "within five seconds"


class Goal:
    """A goal as the server holds it. status: what has become of it."""

    def __init__(self, stamp_s: float) -> None:
        self._id, self.status = GoalID(stamp=rospy.Time.from_sec(stamp_s), id=f"{stamp_s}"), GoalStatus.PENDING

    def get_goal(self) -> str:
        return str(self._id.id)

    def get_goal_id(self) -> GoalID:
        return self._id

    def get_goal_status(self) -> GoalStatus:
        return GoalStatus(status=self.status)

    def set_accepted(self, _: str) -> None:
        self.status = GoalStatus.ACTIVE

    def set_canceled(self, *_: object) -> None:
        self.status = GoalStatus.RECALLED

    def set_succeeded(self, *_: object) -> None:
        self.status = GoalStatus.SUCCEEDED


class Connection:
    """Stands for what actionlib's server does on the wire."""

    def __init__(self, _: str, __: Any, goal_callback: Any, *___: Any) -> None:
        self.goal_callback, self.lock, self.ActionResultType = goal_callback, threading.RLock(), SimpleNamespace

    def register_goal_callback(self, callback: Any) -> None:
        self.goal_callback = callback


def test_move_base_pursues_the_goal_that_comes_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actionlib.simple_action_server.ActionServer", Connection)
    pursued: queue.Queue[str] = queue.Queue()

    def execute(goal: Any) -> None:
        pursued.put(goal)
        server.set_succeeded()

    server = driving.goal_server(execute)
    try:
        for stamp_s in (1000.0, 940.0, 941.0, 100.0):
            server.action_server.goal_callback(Goal(stamp_s))
            assert pursued.get(timeout=PATIENCE_S) == str(stamp_s)
    finally:
        server.need_to_terminate = True
