"""What has become of a goal, told by actionlib's own bookkeeping, without a master."""

import json
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import file_samples
import pytest

pytest.importorskip("rospy")

from actionlib.action_client import ClientGoalHandle, CommStateMachine
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult, MoveBaseGoal

from vsx_ros.control.localization import LocalizationState
from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import Action, Decision, NavigationState, SavedMission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, driving, goal_sender, headers, mission_output
from vsx_ros.ros.driving import SHUTTING_DOWN
from vsx_ros.ros.goal_sender import TAKEN_WITHIN_S, GoalSender
from vsx_ros.ros.mission_output import MissionTopics, MissionWriter
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, RunEvent
from vsx_ros.runs.previous import end_trail
from vsx_ros.slam.state import TrackingResult, TrackingState


class Sent:
    """A goal under way, a clock, and what move_base is told and tells of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 50.0
        monkeypatch.setattr(goal_sender.time, "monotonic", lambda: self.now_s)
        self.cancelled, self.goals = list[GoalID](), list[MoveBaseGoal]()
        self._machine = CommStateMachine(
            MoveBaseActionGoal(goal_id=GoalID(id="one")), None, None, lambda _: None, self.cancelled.append
        )
        monkeypatch.setattr(goal_sender.actionlib, "ActionClient", lambda *_: self)
        self.goal = GoalSender()
        self.goal.act(0, Decision(Action.GO, SE2(), "map", "", ""))

    def send_goal(self, goal: MoveBaseGoal) -> ClientGoalHandle:
        self.goals.append(goal)
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
        assert state is NavigationState.LOST
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


def test_who_cancels_our_goal_is_heard_while_the_base_still_brakes(sent: Sent) -> None:
    sent.tell(GoalStatus.ACTIVE)
    assert not sent.goal.is_cancelled_since(NavigationState.ACTIVE)
    sent.tell(GoalStatus.PREEMPTING)
    assert sent.goal.is_cancelled_since(NavigationState.ACTIVE)
    sent.end(GoalStatus.PREEMPTED, driving.CANCELLED)
    assert sent.goal.is_cancelled_since(NavigationState.ACTIVE)
    assert not sent.goal.is_cancelled_since(NavigationState.CANCELLED), "the mission has heard of it"


def test_our_own_cancellation_is_nobody_else_s(sent: Sent) -> None:
    sent.tell(GoalStatus.ACTIVE)
    sent.goal.cancel()
    sent.tell(GoalStatus.PREEMPTING)
    assert not sent.goal.is_cancelled_since(NavigationState.ACTIVE)


def test_a_goal_that_a_new_move_base_does_not_know_is_lost(sent: Sent) -> None:
    sent.tell(GoalStatus.ACTIVE, "This goal has been accepted by the simple action server")
    sent._machine.update_status(GoalStatusArray())
    assert sent.goal.state() == (NavigationState.LOST, "move_base has lost the goal")


@pytest.mark.parametrize(
    ("status", "reason"), [(GoalStatus.RECALLED, "another goal was received"), (GoalStatus.ABORTED, SHUTTING_DOWN)]
)
def test_a_goal_that_move_base_leaves_for_itself_has_not_failed(sent: Sent, status: int, reason: str) -> None:
    sent.end(status, reason)
    assert sent.goal.state() == (NavigationState.LOST, reason)


@pytest.mark.parametrize(
    ("reason", "state"),
    [
        (driving.CANCELLED, NavigationState.CANCELLED),
        (driving.FOLLOWER_CANCELLED, NavigationState.CANCELLED),
        (driving.REPLACED, NavigationState.REPLACED),
    ],
)
def test_a_goal_that_others_end_is_told_from_one_that_we_cancel(
    sent: Sent, reason: str, state: NavigationState
) -> None:
    sent.tell(GoalStatus.ACTIVE)
    sent.end(GoalStatus.PREEMPTED, reason)
    assert sent.goal.state() == (state, reason)


def test_a_goal_that_we_cancel_has_failed_as_before(sent: Sent) -> None:
    sent.tell(GoalStatus.ACTIVE)
    sent.goal.cancel()
    sent.end(GoalStatus.PREEMPTED, driving.CANCELLED)
    assert sent.goal.state() == (NavigationState.ABORTED, driving.CANCELLED)


@pytest.mark.parametrize("prefix", ["", "robot1"])
def test_only_the_explorer_s_own_drives_by_odometry_leave_the_map_out(
    sent: Sent, prefix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(headers, "_prefix", prefix)
    ahead, where = SE2(0.5, 0.0, 0.0), LocalizationState(SE2(1.0, 0.0, 0.0), Odometry(0, SE2(0.0, 3.0, 0.0)))
    for frame, wanted in (("odom", (ahead, "odom")), ("map", (ahead, "map"))):
        sent.goal.act(0, Decision(Action.GO, ahead, frame, "", ""))
        assert driving.wanted_goal(sent.goals[-1].target_pose, where) == wanted
    user_s = convert.pose_stamped("odom", 0, ahead)
    assert driving.wanted_goal(user_s, where) == (SE2(1.5, -3.0, 0.0), "map")
    with pytest.raises(InputError, match="does not know yet"):
        driving.wanted_goal(user_s, where._replace(T_map_base=None))


class Session:
    """A mission's output in a run folder; the clock and the wheels are the test's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path, at: SE2 | None = None) -> None:
        self.now_s, self.told = 1000.0, list[Any]()
        stamps = SimpleNamespace(now_ns=lambda: round(self.now_s * 1e9), timer_ns=lambda: round(self.now_s * 1e9))
        monkeypatch.setattr(mission_output.time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(mission_output, "headers", stamps)
        monkeypatch.setattr(
            mission_output.rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=self.told.append)
        )
        monkeypatch.setattr(mission_output, "hear_odometry", lambda add: setattr(self, "wheels", add))
        monkeypatch.setattr(mission_output.node, "run_dir", lambda: str(folder))
        monkeypatch.setattr(mission_output.threads, "every", lambda *_: None)
        ranking = SimpleNamespace(views=[])
        selector = SimpleNamespace(ranking=ranking, time_left=SimpleNamespace(at=lambda _: None))
        saved = SavedMission([], [], [SE2()] if at else [], going_home=False, home=None)
        mission: Any = SimpleNamespace(
            paused_by=set(), outcome=None, view_selector=selector, to_save=lambda *_: saved, restore=lambda *_: None
        )
        where: Any = SimpleNamespace(at=lambda _: LocalizationState(odometry=Odometry(0, at or SE2())))
        self.topics = MissionTopics(mission, 0.5)
        self.writer = MissionWriter(mission, threading.Lock(), where, self.topics)
        self.writer.restore(0, SE2())

    def drive(self, seconds: int, metres: float) -> None:
        for k in range(11):
            self.wheels(Odometry(round(k * 1e8), SE2(0.1 * k * metres, 0.0, 0.0)))
        self.now_s += seconds

    def status(self) -> tuple[int, int, float]:
        self.topics.report(Decision(Action.WAIT, None, "map", "", ""), NavigationState.IDLE, None)
        status = json.loads(self.told[-1])
        return status["begun_ns"], status["elapsed_s"], status["driven_m"]


def test_time_and_way_of_a_resumed_run_go_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "run").checkpoint.write(CheckpointData(file_samples.slam_map(), 1, {}, {}))
    for before_s, before_m in ((0, 0.0), (60, 3.0), (120, 6.0)):
        session = Session(monkeypatch, tmp_path / "run")
        session.drive(60, 3.0)
        assert session.status() == ((1000 - before_s) * 10**9, before_s + 60, pytest.approx(before_m + 3.0, abs=0.06))
        session.writer.write()


@pytest.mark.parametrize("off_m", [0.03, 9.0])  # the wheels are a little further than the last frame, or began anew
def test_the_memory_is_as_old_as_the_journal_s_last_frame_whatever_the_clock_says(
    off_m: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """vslam goes on in its own time where the clock is set back."""
    folder = RunFolder.create(tmp_path / "run")
    folder.checkpoint.write(CheckpointData(file_samples.slam_map(), 1, {}, {}))
    result = TrackingResult(0, TrackingState.GOOD, None, 0, 0, keyframe_added=False)
    frames = [
        FrameLine.of(result._replace(stamp_ns=(2000 + k) * 10**9), Odometry(0, SE2(0.1 * k, 0.0, 0.0)), 1.0, None)
        for k in range(6)
    ]
    journal = Journal(folder.journal)
    journal.add(*frames[:4], RunEvent(2003 * 10**9, "slam", "gap", "no odometry"))
    session = Session(monkeypatch, folder.path, SE2(0.3 + off_m, 0.0, 0.0))
    session.writer.write()
    journal.add(*frames[4:])
    end_trail(folder, moved=False)
    trail = SavedMission.of(folder.checkpoint.read_mission() or {}, folder.path).trail
    expected = [SE2(0.3 + (off_m if off_m < 1.0 else 0.0), 0.0, 0.0), SE2(0.4, 0.0, 0.0), SE2(0.5, 0.0, 0.0)]
    assert [pose.x for pose in trail] == pytest.approx([pose.x - 0.5 for pose in expected])
