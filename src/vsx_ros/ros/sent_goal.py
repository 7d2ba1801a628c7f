"""A goal that was sent to move_base, and what has become of it."""

from __future__ import annotations

import time

import actionlib
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from vsx_ros.exploration.decision import NavigationState

TAKEN_WITHIN_S = 2.0
"""actionlib waits for ever for a goal that was lost on its way, as to a move_base that died at that moment."""


def is_served(client: actionlib.ActionClient) -> bool:
    """Whether an action server is connected. The client's own wait for it goes by ROS time, which may stand."""
    ends = client.pub_goal, client.pub_cancel, client.result_sub, client.feedback_sub
    return all(end.get_num_connections() > 0 for end in ends)


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
