"""``vsx stop`` on a slow laptop: what it waits for, and how long; without a master."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from nav_msgs.msg import Odometry
from waiting import PATIENCE_S

from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_ros.errors import ConfigError
from vsx_ros.ros import calls, operator_command
from vsx_ros.runs.process import DONE


class Graph:
    """joins_s and answers_s: what it takes to join the master and to get the base's answer, on a clock of its own.
    heard: the odometry that a new subscriber hears at once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.joins_s = self.answers_s = self.now_s = 0.0
        self.heard: list[float] = [0.0, 0.0]
        self.subscribers: list[Callable[[Odometry], None]] = []
        self.subscribed = threading.Event()
        monkeypatch.setattr(operator_command.logs, "quiet_failures", lambda: None)
        monkeypatch.setattr(operator_command, "join", lambda _: self._pass(self.joins_s))
        monkeypatch.setattr(calls, "within", self._within)
        monkeypatch.setattr(rospy, "ServiceProxy", lambda *_: lambda _: self._pass(self.answers_s))
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "signal_shutdown", lambda _: None)

    def _pass(self, seconds: float) -> None:
        self.now_s += seconds

    def _within(self, seconds: float, ask: Callable[[], Any], whom: str) -> Any:
        began_s, answer = self.now_s, ask()
        if self.now_s - began_s > seconds:
            raise calls.NoAnswer(f"{whom} did not answer in {seconds:g} s")
        return answer

    def _subscribe(self, topic: str, _: object, callback: Callable[[Odometry], None], **__: object) -> None:
        self.subscribers.append(callback)
        for k, v_m_s in enumerate(self.heard):
            callback(odometry(v_m_s, 1.0 + 0.1 * k))
        self.subscribed.set()


def odometry(v_m_s: float, stamp_s: float = 1.0, x_m: float = 0.0) -> Odometry:
    msg = Odometry()
    msg.header.stamp, msg.pose.pose.position.x = rospy.Time.from_sec(stamp_s), x_m
    msg.pose.pose.orientation.w = 1.0
    msg.twist.twist.linear.x = v_m_s
    return msg


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    return Graph(monkeypatch)


def test_a_slow_master_leaves_the_base_its_time(graph: Graph) -> None:
    graph.joins_s, graph.answers_s = 9.0, 5.0
    assert operator_command.stop(release=False) == DONE
    assert operator_command.stop(release=True) == DONE


@pytest.mark.parametrize(("joins_s", "answers_s", "whom"), [(99.0, 0.0, "the ROS master"), (0.0, 7.0, "the base")])
def test_who_does_not_answer_is_named(graph: Graph, joins_s: float, answers_s: float, whom: str) -> None:
    graph.joins_s, graph.answers_s = joins_s, answers_s
    with pytest.raises(DeviceTimeout, match=f"{whom} did not answer in .* s; use its power button"):
        operator_command.stop(release=False)


def test_one_connection_hears_the_wheels_come_to_rest(graph: Graph) -> None:
    graph.heard = [0.3, 0.2, 0.1, 0.0]
    assert operator_command.stop(release=False) == DONE
    assert len(graph.subscribers) == 1


def test_what_came_while_this_machine_was_late_counts(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_command, "_STAND_S", 0.0)
    graph.heard = [0.3, 0.0]
    assert operator_command.stop(release=False) == DONE


def test_odometry_has_time_to_be_connected(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_command, "_STAND_S", 0.0)
    monkeypatch.setattr(operator_command, "_STOP_S", PATIENCE_S)
    monkeypatch.setattr(operator_command, "_LOOK_S", 0.0)
    graph.heard, codes = [], list[int]()
    stopping = threading.Thread(target=lambda: codes.append(operator_command.stop(release=False)), daemon=True)
    stopping.start()
    assert graph.subscribed.wait(PATIENCE_S)
    graph.subscribers[0](odometry(0.0))
    stopping.join(PATIENCE_S)
    assert codes == [DONE]


def test_a_base_that_tells_no_speeds_stands_when_its_pose_does(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    def hears(step_m: float) -> None:
        """Every reading twice, 50 ms apart."""
        messages = [odometry(0.0, 1.0 + 0.05 * (k // 2), step_m * (k // 2)) for k in range(8)]
        monkeypatch.setattr(rospy, "Subscriber", lambda _, __, hear, **___: [hear(msg) for msg in messages])

    monkeypatch.setattr(operator_command, "_STAND_S", 0.1)
    hears(0.0)
    assert operator_command.stop(release=False) == DONE
    hears(0.015)
    with pytest.raises(DeviceError, match=r"its odometry says 0\.30 m/s"):
        operator_command.stop(release=False)


def test_a_base_that_rolls_on_or_says_nothing_is_no_success(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_command, "_STAND_S", 0.01)
    graph.heard = [0.3] * 3
    with pytest.raises(DeviceError, match=r"its odometry says 0\.30 m/s"):
        operator_command.stop(release=False)
    monkeypatch.setattr(operator_command, "_STOP_S", 0.01)
    graph.heard = []
    with pytest.raises(DeviceError, match="it sends no odometry"):
        operator_command.stop(release=False)


def test_a_map_that_nobody_can_save_is_told_soon(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    """The two minutes are for the disk. The parameter for the file stays as it is."""

    def wait(_: str, timeout: float) -> None:
        graph.now_s += timeout
        raise rospy.ROSException("timeout exceeded")

    monkeypatch.setattr(rospy, "wait_for_service", wait)
    monkeypatch.setattr(rospy, "set_param", lambda *_: pytest.fail("nobody saves a map"))
    with pytest.raises(ConfigError, match="nobody offers .*; start the robot"):
        operator_command.save_map(Path("lab.vsxmap"))
    assert graph.now_s <= 5.0
