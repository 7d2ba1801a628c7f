"""``vsx go``, without a master: what it asks of the robot, in which order, and how it ends."""

from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseGoal

from vsx_ros.cli import main
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, go, operator_command, topics
from vsx_ros.runs.process import DONE, FAILED


class Robot:
    """Stands for the running robot. asked: service calls and goals, oldest first. ends: status of every goal."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        self.ends, self.explores = GoalStatus.SUCCEEDED, True
        for module, name in (
            (operator_command, "join"), (operator_command.logs, "quiet_failures"), (go.headers, "adopt_prefix"),
            (go, "hear_operator_hold"), (rospy, "signal_shutdown"),
        ):  # fmt: skip
            monkeypatch.setattr(module, name, lambda *_: None)
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(go.headers, "now_ns", lambda: 10**9)
        monkeypatch.setattr(go, "subscribe", self._subscribe)
        monkeypatch.setattr(go, "is_served", lambda _: True)
        monkeypatch.setattr(go.calls, "service", self._service)
        monkeypatch.setattr(go.actionlib, "ActionClient", lambda *_: self)

    def _subscribe(self, _: str, __: type, take: Any, **___: Any) -> None:
        pose = PoseWithCovarianceStamped()
        pose.pose.pose = convert.pose_msg(SE2(1.0, 0.0, 0.0))
        take(pose)

    def _service(self, name: str, *_: Any, **__: Any) -> None:
        if not self.explores:
            raise rospy.ROSException("unavailable")
        self.asked.append(name)

    def send_goal(self, goal: MoveBaseGoal) -> "Robot":
        self.asked.append(convert.se2(goal.target_pose.pose))
        return self

    def get_comm_state(self) -> int:
        return int(CommState.DONE)

    def get_terminal_state(self) -> int:
        return int(self.ends)

    def get_goal_status_text(self) -> str:
        return "the way is blocked"


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
    robot.ends = GoalStatus.ABORTED
    assert main.execute(["go", "-1,2"]) == FAILED
    assert "not reached: the way is blocked" in capsys.readouterr().err
