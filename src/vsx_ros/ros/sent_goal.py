"""Goals that are sent to move_base, and what has become of them."""

import time

import actionlib
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from vsx_ros.exploration.decision import Action, Decision, NavigationState
from vsx_ros.ros import convert, topics

TAKEN_WITHIN_S = 2.0
"""actionlib waits for ever for a goal that was lost on its way, as to a move_base that died at that moment."""


class SentGoal:
    """Its state at any moment, and an end to it."""

    def __init__(self, handle: actionlib.ClientGoalHandle) -> None:
        self._handle = handle
        self._sent_s = time.monotonic()
        self._untaken = False

    def state(self) -> tuple[NavigationState, str]:
        """ACTIVE, SUCCEEDED or ABORTED, and what move_base says of it. A goal that nobody takes is cancelled."""
        reason, comm = str(self._handle.get_goal_status_text()), self._handle.get_comm_state()
        if comm == CommState.WAITING_FOR_GOAL_ACK and time.monotonic() - self._sent_s > TAKEN_WITHIN_S:
            self._untaken = True
            self.cancel()
        if self._untaken:
            return NavigationState.ABORTED, f"move_base has not taken the goal within {TAKEN_WITHIN_S:g} s"
        if comm != CommState.DONE:
            return NavigationState.ACTIVE, reason
        if self._handle.get_terminal_state() == GoalStatus.SUCCEEDED:
            return NavigationState.SUCCEEDED, reason
        return NavigationState.ABORTED, reason

    def cancel(self) -> None:
        """Give up this goal and no other: after a pause somebody else may send one."""
        self._handle.cancel()


class GoalSender:
    """The client of move_base: one goal at a time."""

    def __init__(self) -> None:
        self._client = actionlib.ActionClient(topics.MOVE_BASE_ACTION, MoveBaseAction)
        self._goal: SentGoal | None = None

    @property
    def is_served(self) -> bool:
        """Whether an action server is connected. The client's own wait for it goes by ROS time, which may stand."""
        ends = self._client.pub_goal, self._client.pub_cancel, self._client.result_sub, self._client.feedback_sub
        return all(end.get_num_connections() > 0 for end in ends)

    def state(self) -> tuple[NavigationState, str]:
        """Of the newest goal; IDLE before the first."""
        return self._goal.state() if self._goal is not None else (NavigationState.IDLE, "")

    def act(self, now_ns: int, decision: Decision) -> None:
        """Send the goal of a decision, or cancel the one under way."""
        if decision.action is Action.GO and decision.goal is not None:
            goal = convert.pose_stamped(decision.frame, now_ns, decision.goal)
            self._goal = SentGoal(self._client.send_goal(MoveBaseGoal(goal)))
        elif decision.action in (Action.CANCEL, Action.FINISH) and self.state()[0] is NavigationState.ACTIVE:
            assert self._goal is not None
            self._goal.cancel()

    def cancel_all(self) -> None:
        """Those of others, too: nobody wants to drive."""
        self._client.cancel_all_goals()
