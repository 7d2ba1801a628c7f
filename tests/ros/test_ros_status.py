"""What ``vsx status`` makes of topics that come late or at once, without a master."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from vsx_ros.ros import status, topics
from vsx_ros.ros.status import StatusBoard

RATE_HZ = 15.0
TIMELESS = {"left_s", "battery_left_s"}


class Graph:
    """Its clock passes while somebody sleeps. events: what happens at each look, one after the other. late_s: how late
    every look is."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.late_s, self.connected = 1000.0, 0.0, 0
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.events: Iterator[Callable[[], None]] = iter(())
        monkeypatch.setattr(status, "subscribe", self._subscribe)
        monkeypatch.setattr(status, "hear_operator_hold", lambda callback: self._subscribe("", None, callback))
        monkeypatch.setattr(status, "time", SimpleNamespace(monotonic=lambda: self.now_s, sleep=self._sleep))
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        self.board = StatusBoard()

    def _subscribe(self, topic: str, _: object, callback: Callable[[Any], None], **__: object) -> Any:
        self.callbacks[topic] = callback
        return SimpleNamespace(get_num_connections=lambda: self.connected)

    def _sleep(self, seconds: float) -> None:
        self.now_s += seconds + self.late_s
        next(self.events, lambda: None)()

    def image(self, stamp_s: float) -> None:
        header = Header(stamp=rospy.Time.from_sec(stamp_s))
        self.callbacks[topics.CAMERA_INFO](CameraInfo(header=header))

    def tell_all(self) -> None:
        self.board._set(**{name: 0 for name in self.board._facts if name not in TIMELESS})

    @property
    def camera_hz(self) -> float | None:
        rate_hz: float | None = self.board.facts()["camera_hz"]
        return rate_hz


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    return Graph(monkeypatch)


def test_one_image_is_no_rate_until_the_next_should_have_come(graph: Graph) -> None:
    assert graph.camera_hz is None
    graph.image(50.0)
    assert graph.camera_hz is None
    graph.now_s += 2.0
    assert graph.camera_hz == 0.0


def test_images_that_come_all_at_once_have_the_rate_of_the_camera(graph: Graph) -> None:
    graph.image(40.0)
    graph.now_s += 2.0
    for k in range(30):
        graph.image(50.0 + k / RATE_HZ)
    assert graph.camera_hz == RATE_HZ
    graph.now_s += 2.0
    assert graph.camera_hz == 0.0, "the camera has stopped"


def test_images_without_a_time_have_no_rate(graph: Graph) -> None:
    for _ in range(6):
        graph.image(0.0)
        graph.now_s += 0.5
    assert graph.camera_hz is None


def test_topics_that_are_connected_late_are_waited_for(graph: Graph) -> None:
    def connect() -> None:
        graph.connected = 1

    nothing: list[Callable[[], None]] = [lambda: None] * 30
    graph.events = iter([*nothing, connect, *nothing, graph.tell_all])
    graph.image(50.0)
    graph.board.wait()
    assert graph.board.facts()["state"] == 0


def test_a_machine_that_was_late_waits_for_as_many_looks(graph: Graph) -> None:
    graph.late_s = 3600.0
    graph.events = iter([lambda: None, graph.tell_all])
    graph.image(50.0)
    graph.board.wait()
    assert graph.board.facts()["state"] == 0


def test_a_robot_that_says_nothing_is_not_waited_for_long(graph: Graph) -> None:
    began_s = graph.now_s
    graph.board.wait()
    assert graph.now_s - began_s == pytest.approx(4.0, abs=0.2)
