"""``vsx go``, without a master: what it asks of the robot, in which order, and how it ends."""

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped

from vsx_ros.cli import main
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, go, operator_command, topics
from vsx_ros.runs.process import DONE, FAILED


class Robot:
    """Stands for the running robot. asked: service calls and goals, oldest first. end: what becomes of every goal."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        self.end, self.explores, self.now_s = (NavigationState.SUCCEEDED, ""), True, 0.0
        self.is_served, self.at_goal = True, (lambda: None)
        for module, name in (
            (operator_command, "join"), (operator_command.logs, "quiet_failures"), (go.headers, "adopt_prefix"),
            (go, "hear_operator_hold"), (rospy, "signal_shutdown"),
        ):  # fmt: skip
            monkeypatch.setattr(module, name, lambda *_: None)
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(go.headers, "now_ns", lambda: 10**9)
        monkeypatch.setattr(go, "subscribe", self._subscribe)
        monkeypatch.setattr(go, "time", SimpleNamespace(monotonic=lambda: self.now_s, sleep=self._sleep))
        monkeypatch.setattr(go.calls, "service", self._service)
        monkeypatch.setattr(go, "GoalSender", lambda: self)

    def _subscribe(self, _: str, __: type, take: Any, **___: Any) -> None:
        pose = PoseWithCovarianceStamped()
        pose.pose.pose = convert.pose_msg(SE2(1.0, 0.0, 0.0))
        take(pose)

    def _service(self, name: str, *_: Any, **__: Any) -> None:
        if not self.explores:
            raise rospy.ROSException("unavailable")
        self.asked.append(name)

    def _sleep(self, seconds: float) -> None:
        self.now_s += seconds

    def send(self, _: int, frame: str, goal: SE2) -> None:
        assert frame == topics.MAP_FRAME
        self.asked.append(goal)
        self.at_goal()

    def state(self) -> tuple[NavigationState, str]:
        return self.end


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    return Robot(monkeypatch)


@pytest.mark.parametrize(("words", "before"), [([], []), (["--stay"], [topics.EXPLORE_PAUSE])])
def test_stay_pauses_the_exploration_before_the_goal_is_sent(
    robot: Robot, words: list[str], before: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.execute(["go", "1,2,90", *words]) == DONE
    *asked, goal = robot.asked
    assert asked == before
    assert goal.as_array() == pytest.approx([1.0, 2.0, 1.5708], abs=1e-4)
    assert capsys.readouterr().out == "reached 1.00, 2.00, 90 deg\n"


def test_stay_without_an_exploration_drives_nowhere_and_says_so(
    robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.explores = False
    assert main.execute(["go", "1,2", "--stay"]) == FAILED
    assert robot.asked == []
    assert "--stay: no exploration answers" in capsys.readouterr().err


def test_a_goal_that_is_not_reached_says_why(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    robot.end = NavigationState.ABORTED, "the way is blocked"
    assert main.execute(["go", "-1,2"]) == FAILED
    assert "not reached: the way is blocked" in capsys.readouterr().err


def test_a_goal_that_is_lost_on_its_way_ends_the_wait(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    robot.end = NavigationState.LOST, "move_base has not taken the goal within 2 s"
    assert main.execute(["go", "1,2"]) == FAILED
    assert "not reached: move_base has not taken the goal" in capsys.readouterr().err


def test_a_move_base_that_ends_and_does_not_come_back_ends_the_wait(
    robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.end = NavigationState.ACTIVE, ""
    robot.at_goal = lambda: setattr(robot, "is_served", False)
    assert main.execute(["go", "1,2"]) == FAILED
    assert "not reached: move_base has ended" in capsys.readouterr().err
