"""A node that has died is silent in the live view and in ``vsx status``, whatever it said last."""

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from chromium import EXECUTABLE
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from served_page import ServedPage
from std_msgs.msg import String

from vsx_ros.ros import silence, status, topics
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.dashboard.feed import Board, Feed
from vsx_ros.ros.status import StatusBoard, screen

MISSION = {"state": "mapping", "reason": "driving to a view", "left_s": 230}
HEALTH = {"mobile_base: safety": "driving for navi", "vslam: tracking": "TRACKING", "explore: mission": "mapping"}
NODES = "explore", "vslam", "mobile_base", "dock"


class Robot:
    """Its nodes say what they say once a second. The clock passes in ``live``, and ROS time stands."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        self.callbacks: list[tuple[str, Callable[[Any], None]]] = []
        for module in (feed, status):
            monkeypatch.setattr(module, "subscribe", self._subscribe)
        monkeypatch.setattr(status, "hear_operator_hold", lambda _: None)
        monkeypatch.setattr(silence, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        monkeypatch.setattr(feed.threads, "worker", lambda *_: None)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "get_namespace", lambda: "/")
        self.board, self.status = Board(), StatusBoard()
        self.feed = Feed(self.board)
        self.feed._subscribe()

    def _subscribe(self, topic: str, _: object, callback: Callable[[Any], None], **__: object) -> None:
        self.callbacks.append((topic, callback))

    def _say(self, topic: str, msg: object) -> None:
        for heard, callback in self.callbacks:
            if heard == topic:
                callback(msg)

    def begin(self) -> None:
        """The state of SLAM comes on change."""
        self._say(topics.SLAM_STATE, DiagnosticStatus(name="TRACKING"))

    def live(self, seconds: int, *nodes: str) -> None:
        for _ in range(seconds):
            if "explore" in nodes:
                self._say(topics.EXPLORE_STATUS, String(json.dumps(MISSION)))
            if "dock" in nodes:
                docked = {"state": "docked", "reason": "on the dock", "battery_left_s": 60}
                self._say(topics.DOCK_STATUS, String(json.dumps(docked)))
            for name, message in HEALTH.items():
                if name.partition(":")[0] in nodes:
                    told = DiagnosticStatus(0, name, message, "", [KeyValue("estop", "False")])
                    self._say(topics.DIAGNOSTICS, DiagnosticArray(status=[told]))
            self.now_s += 1.0
            self.feed.tell_silent()

    def page(self, subject: str) -> Any:
        return next(json.loads(note.text) for note in self.board.newer_than(0, 0.0) if note.subject == subject)

    def screen(self) -> dict[str, str]:
        return dict(line.split(None, 1) for line in screen(self.status.facts()).splitlines())


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    made = Robot(monkeypatch)
    made.begin()
    return made


def test_nodes_that_speak_are_as_they_say(robot: Robot) -> None:
    robot.live(60, *NODES)
    assert robot.page("silent") == []
    assert {name: word for name, (_, word, _) in robot.page("health").items()} == HEALTH
    shown = robot.screen()
    assert shown["exploration"] == "mapping: driving to a view; about 4 minutes left"
    assert (shown["slam"], shown["wheels"], shown["dock"]) == ("TRACKING", "driving for navi", "docked: on the dock")


@pytest.mark.parametrize(
    ("dead", "line", "subjects"),
    [
        ("explore", "exploration", ["mission"]),
        ("vslam", "slam", ["slam"]),
        ("mobile_base", "wheels", []),
        ("dock", "dock", []),
    ],
)
def test_a_dead_node_is_silent_after_four_seconds_until_it_speaks_again(
    robot: Robot, dead: str, line: str, subjects: list[str]
) -> None:
    robot.live(5, *NODES)
    before, others = robot.screen(), [node for node in NODES if node != dead]
    robot.live(4, *others)
    assert robot.page("silent") == subjects
    for name, (level, message, values) in robot.page("health").items():
        gone = name.startswith(dead)
        assert (level, message) == ((3, f"silent; before: {HEALTH[name]}") if gone else (0, HEALTH[name]))
        assert values == {"estop": "False"}
    assert robot.screen() == {**before, line: "silent", **({"battery": "-"} if dead == "dock" else {})}
    robot.live(2, *NODES)
    assert robot.page("silent") == []
    assert all(level == 0 for level, _, _ in robot.page("health").values())
    assert robot.screen() == before


def test_the_end_of_a_mission_stays_true(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MISSION, "state", "done")
    robot.live(1, *NODES)
    robot.live(9)
    assert robot.screen()["exploration"].startswith("done: driving to a view")


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_page_greys_what_is_silent(page: ServedPage) -> None:
    page.open()
    page.wait("$('mission').className === 'pill good' && $('slam').className === 'pill good'")
    page.post("health", {"vslam: input": [3, "silent; before: 30 images a second", {}]})
    page.post("silent", ["mission", "slam"])
    page.wait("$('mission').textContent === 'SILENT' && $('mission').className === 'pill '")
    assert page.value("[$('slam').textContent, $('slam').className]") == ["camera silent", "pill "]
    assert "says nothing any more; before: driving to a view" in page.value("$('why').textContent")
    assert page.value("document.querySelector('#health .dot').title") == "silent"
    assert "–\nimages / s" in page.value("$('numbers').innerText")
    page.post("mission", {"state": "done", "reason": "all is known"})
    page.wait("$('mission').textContent === 'DONE' && $('mission').className === 'pill good'")
