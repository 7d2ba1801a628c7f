"""Goals for the base, sent to move_base."""

import time

import actionlib
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from vsx_ros.exploration.decision import Action, Decision, NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import ODOM_FRAME
from vsx_ros.ros import convert, topics
from vsx_ros.ros.driving import CANCELLED, FOLLOWER_CANCELLED, SHUTTING_DOWN

TAKEN_WITHIN_S = 2.0
"""actionlib waits forever for a goal that was lost, e.g. because move_base died at that moment."""


class GoalSender:
    """The client of move_base: one goal at a time."""

    def __init__(self) -> None:
        self._client = actionlib.ActionClient(topics.MOVE_BASE_ACTION, MoveBaseAction)
        self._goal: actionlib.ClientGoalHandle | None = None
        self._sent_s = 0.0
        self._untaken = self._cancelled = False

    @property
    def is_served(self) -> bool:
        """Whether move_base is connected. The client's own wait uses ROS time, which may stand still."""
        client = self._client
        ends = client.pub_goal, client.pub_cancel, client.result_sub, client.feedback_sub
        return all(end.get_num_connections() > 0 for end in ends)

    def act(self, now_ns: int, decision: Decision) -> None:
        """Send the goal of a decision, or cancel our current goal. Other goals stay: during a pause another client may
        send one."""
        if decision.action is Action.GO and decision.goal is not None:
            self.send(now_ns, topics.BLIND_FRAME if decision.frame == ODOM_FRAME else decision.frame, decision.goal)
        elif decision.action in (Action.CANCEL, Action.FINISH):
            self.cancel()

    def send(self, now_ns: int, frame: str, goal: SE2) -> None:
        """Drive there; it replaces our last goal."""
        self._goal = self._client.send_goal(MoveBaseGoal(convert.pose_stamped(frame, now_ns, goal)))
        self._sent_s, self._untaken, self._cancelled = time.monotonic(), False, False

    def cancel(self) -> None:
        """Cancel our goal, if it is pursued."""
        if self._goal is not None and self.state()[0] is NavigationState.ACTIVE:
            self._cancelled = True
            self._goal.cancel()

    def state(self) -> tuple[NavigationState, str]:
        """State of the newest goal, and move_base's reason; IDLE before the first goal. Cancels a goal that is not
        accepted in time."""
        if self._goal is None:
            return NavigationState.IDLE, ""
        reason, comm = str(self._goal.get_goal_status_text()), self._goal.get_comm_state()
        if comm == CommState.WAITING_FOR_GOAL_ACK and time.monotonic() - self._sent_s > TAKEN_WITHIN_S:
            self._untaken = True
            self._goal.cancel()
        if self._untaken:
            return NavigationState.LOST, f"move_base has not taken the goal within {TAKEN_WITHIN_S:g} s"
        if comm != CommState.DONE:
            return NavigationState.ACTIVE, reason
        end = self._goal.get_terminal_state()
        if end == GoalStatus.LOST:  # by a move_base that was started anew; the text is an older one
            return NavigationState.LOST, "move_base has lost the goal"
        if end == GoalStatus.RECALLED or reason == SHUTTING_DOWN:
            return NavigationState.LOST, reason
        if end == GoalStatus.PREEMPTED and not self._cancelled:
            cancelled = reason in (CANCELLED, FOLLOWER_CANCELLED)
            return NavigationState.CANCELLED if cancelled else NavigationState.REPLACED, reason
        return NavigationState.SUCCEEDED if end == GoalStatus.SUCCEEDED else NavigationState.ABORTED, reason

    def is_cancelled_since(self, before: NavigationState) -> bool:
        """Whether somebody else has cancelled our goal, which was in this state before. The base may still brake."""
        if self._goal is None or self._cancelled or before is not NavigationState.ACTIVE:
            return False
        return self._goal.get_comm_state() == CommState.PREEMPTING or self.state()[0] is NavigationState.CANCELLED

    def cancel_all(self) -> None:
        """Cancel all goals, also those of other clients: nothing may drive."""
        self._client.cancel_all_goals()
