"""What has become of a goal, told by actionlib's own bookkeeping, without a master."""

import pytest

pytest.importorskip("rospy")

from actionlib.action_client import ClientGoalHandle, CommStateMachine
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult

from vsx_ros.exploration.decision import Action, Decision, NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import mission_output
from vsx_ros.ros.mission_output import TAKEN_WITHIN_S, GoalSender


class Sent:
    """A goal under way, a clock, and what move_base is told and tells of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 50.0
        monkeypatch.setattr(mission_output.time, "monotonic", lambda: self.now_s)
        self.cancelled: list[GoalID] = []
        self._machine = CommStateMachine(
            MoveBaseActionGoal(goal_id=GoalID(id="one")), None, None, lambda _: None, self.cancelled.append
        )
        monkeypatch.setattr(mission_output.actionlib, "ActionClient", lambda *_: self)
        self.goal = GoalSender()
        self.goal.act(0, Decision(Action.GO, SE2(), "map", "", ""))

    def send_goal(self, _: object) -> ClientGoalHandle:
        return ClientGoalHandle(self._machine)

    def tell(self, status: int, text: str = "") -> None:
        self._machine.update_status(GoalStatusArray(status_list=[GoalStatus(GoalID(id="one"), status, text)]))

    def end(self, status: int, text: str) -> None:
        self._machine.update_result(MoveBaseActionResult(status=GoalStatus(GoalID(id="one"), status, text)))


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Sent:
    return Sent(monkeypatch)


def test_a_goal_that_nobody_takes_is_given_up_soon(sent: Sent) -> None:
    sent.now_s += TAKEN_WITHIN_S
    assert sent.goal.state() == (NavigationState.ACTIVE, "")
    sent.now_s += 0.1
    for _ in range(2):
        state, reason = sent.goal.state()
        assert state is NavigationState.ABORTED
        assert "move_base has not taken the goal" in reason
    assert [goal.id for goal in sent.cancelled] == ["one"], "one that arrives yet shall not be begun"


@pytest.mark.parametrize(
    ("status", "state"),
    [(GoalStatus.SUCCEEDED, NavigationState.SUCCEEDED), (GoalStatus.ABORTED, NavigationState.ABORTED)],
)
def test_a_goal_that_is_taken_lasts_until_it_has_ended(sent: Sent, status: int, state: NavigationState) -> None:
    sent.tell(GoalStatus.ACTIVE)
    sent.now_s += 1000.0
    assert sent.goal.state()[0] is NavigationState.ACTIVE
    sent.end(status, "why")
    assert sent.goal.state() == (state, "why")


def test_a_goal_that_a_new_move_base_does_not_know_has_ended(sent: Sent) -> None:
    sent.tell(GoalStatus.ACTIVE)
    sent._machine.update_status(GoalStatusArray())
    assert sent.goal.state()[0] is NavigationState.ABORTED
