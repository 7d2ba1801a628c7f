"""Commands of the page that move the robot: what they check, and what they publish; without a master."""

import json
import threading
import time
from concurrent import futures
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist

from vsx_ros.ros import topics
from vsx_ros.ros.dashboard import drives
from vsx_ros.ros.dashboard.drives import Drives
from vsx_ros.ros.dashboard.server import Answer

WAY = {"goal": [1.0, 2.0, 0.5], "points": [[0.0, 0.0], [1.0, 2.0]], "length_m": 2.24, "seconds": 9.6}


class Graph:
    """What would be published, and what services and topics say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.published: list[tuple[str, Any]] = []
        self.listeners, self.connects_s = 1, 0.0
        self.planned = Answer(True, json.dumps(WAY))
        self.goals = GoalStatusArray()
        monkeypatch.setattr(drives.rospy, "Publisher", self._publisher)
        monkeypatch.setattr(drives.rospy, "wait_for_message", self._message)
        monkeypatch.setattr(drives.rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(drives.rospy, "get_name", lambda: "/dashboard")
        monkeypatch.setattr(drives.rospy.Time, "now", lambda: rospy.Time(1))
        monkeypatch.setattr(drives, "answer_of", lambda *_, **__: self.planned)
        self.drives = Drives(0.2, 0.6)

    def _publisher(self, topic: str, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(
            publish=lambda msg: self.published.append((topic, msg)), get_num_connections=lambda: self.listeners,
            resolved_name=f"/{topic}",
        )  # fmt: skip

    def _message(self, topic: str, *_: Any, timeout: float) -> GoalStatusArray:
        if not self.listeners or timeout < self.connects_s:
            raise rospy.ROSException("nobody")
        return self.goals


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    return Graph(monkeypatch)


def test_a_plan_is_told_and_moves_nothing(graph: Graph) -> None:
    assert graph.drives.plan("{}") == Answer(True, "2.2 m, about 10 s", WAY)
    graph.planned = Answer(False, "the goal lies outside the map")
    assert graph.drives.plan("{}") == graph.planned
    assert graph.published == []


def test_of_many_plans_asked_at_once_the_first_and_the_last_are_made(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    begun, go_on = threading.Semaphore(0), threading.Semaphore(0)

    def slow(_service: str, _kind: object, text: str, **_: object) -> Answer:
        made.append(text)
        begun.release()
        go_on.acquire()
        return graph.planned

    monkeypatch.setattr(drives, "answer_of", slow)
    with futures.ThreadPoolExecutor(8) as pool:
        asked = [pool.submit(graph.drives.plan, "0")]
        begun.acquire()
        for k in range(1, 8):
            asked.append(pool.submit(graph.drives.plan, str(k)))
            while graph.drives._asked < k + 1:
                time.sleep(0.001)
        go_on.release(8)
    answers = [future.result() for future in asked]
    assert made == ["0", "7"]
    assert [answer.ok for answer in answers] == [True] + [False] * 6 + [True]
    assert "another place" in answers[3].message


def test_go_sends_the_planned_goal_to_move_base(graph: Graph) -> None:
    answer = graph.drives.go("{}")
    assert (answer.ok, answer.message) == (True, "the robot drives to 1.00, 2.00: 2.2 m, about 10 s")
    [(topic, msg)] = graph.published
    assert topic == topics.MOVE_BASE_GOAL
    assert msg.goal_id.id.startswith("/dashboard-")  # whose it is, for the mission
    place = msg.goal.target_pose
    assert place.header.frame_id == topics.MAP_FRAME
    assert (place.pose.position.x, place.pose.position.y) == (1.0, 2.0)


def test_a_goal_without_a_way_or_without_anyone_to_drive_there_is_not_sent(graph: Graph) -> None:
    graph.listeners = 0
    assert "move_base" in graph.drives.go("{}").message
    graph.listeners, graph.planned = 1, Answer(False, "no way")
    assert graph.drives.go("{}") == Answer(False, "no way")
    assert graph.published == []


def test_ending_a_drive_leaves_the_goals_of_the_exploration(graph: Graph) -> None:
    assert not graph.drives.end().ok
    states = ("/explore-1", GoalStatus.ACTIVE), ("/rviz-2", GoalStatus.ACTIVE), ("/dashboard-3", GoalStatus.SUCCEEDED)
    sent = rospy.Time(5)
    graph.goals = GoalStatusArray(status_list=[GoalStatus(GoalID(sent, name), state, "") for name, state in states])
    assert graph.drives.end() == Answer(True, "the drive is ended")
    by_name_alone = GoalID(id="/rviz-2")  # with its stamp it would end all older ones
    assert graph.published == [(topics.MOVE_BASE_CANCEL, by_name_alone)]
    graph.listeners = 0
    assert "move_base" in graph.drives.end().message


def test_a_drive_ends_on_a_machine_that_takes_seconds_to_hear_of_it(graph: Graph) -> None:
    graph.connects_s = 8.0
    graph.goals = GoalStatusArray(status_list=[GoalStatus(GoalID(id="/rviz-2"), GoalStatus.ACTIVE, "")])
    assert graph.drives.end().ok


def test_the_stick_drives_by_the_input_of_teleop(graph: Graph) -> None:
    first = graph.drives.drive('{"forward": 1, "left": 0, "ticket": 0}')
    assert first.data is not None
    again = graph.drives.drive(json.dumps({"forward": 0.5, "left": -1, "ticket": first.data["ticket"]}))
    assert again.ok
    assert graph.drives.drive('{"forward": 0, "left": 0, "ticket": 0}') == Answer(True, "", {"ticket": 0})
    told: list[tuple[str, Twist]] = graph.published
    assert {topic for topic, _ in told} == {topics.COMMAND_TELEOP}
    assert [(msg.linear.x, msg.angular.z) for _, msg in told] == [(0.1, -0.6), (0.0, 0.0)]


def test_a_stick_that_no_base_hears_says_so(graph: Graph) -> None:
    graph.listeners = 0
    answer = graph.drives.drive('{"forward": 1, "left": 0, "ticket": 0}')
    assert not answer.ok
    assert "mobile_base" in answer.message


@pytest.mark.parametrize(
    "text",
    [
        "", "3", "{", '{"forward": 1}',
        '{"forward": NaN, "left": 0, "ticket": 0}', '{"forward": 2, "left": 0, "ticket": 0}',
        '{"forward": 0, "left": -1.01, "ticket": 0}', '{"forward": 0, "left": Infinity, "ticket": 0}',
        '{"forward": true, "left": 0, "ticket": 0}', '{"forward": "1", "left": 0, "ticket": 0}',
        '{"forward": 1, "left": 0, "ticket": null}', '{"forward": 1, "left": 0, "ticket": 1e300}',
    ],
)  # fmt: skip
def test_a_movement_that_is_none_is_refused_in_one_sentence_and_moves_nothing(graph: Graph, text: str) -> None:
    answer = graph.drives.drive(text)
    assert not answer.ok
    assert answer.message
    assert "\n" not in answer.message
    assert graph.published == []
