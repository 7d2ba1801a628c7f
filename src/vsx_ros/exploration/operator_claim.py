"""The operator's claim on the robot: the mission yields to it, and goes on when it is over."""

from vsx_ros.exploration.decision import SECOND_NS, MissionLog, MissionState, Situation
from vsx_ros.slam.state import TrackingState

_LOST_WAIT_NS = 5 * SECOND_NS  # on the way to a goal of the user's, for the camera to be found by itself


class OperatorClaim:
    """Held wheels come before a goal of the user's. given_up: identity of the last such goal that was given up; whoever
    pursues it is to end it."""

    def __init__(self, log: MissionLog) -> None:
        self._log = log
        self._lost_since_ns: int | None = None
        self._pursued = self.given_up = ""

    def of(self, now_ns: int, situation: Situation) -> tuple[MissionState, str] | None:
        """The state that the claim asks for, and why; None without one. A goal in the map of a camera that stays lost
        is no claim: it cannot be driven to before the camera is found."""
        goal = situation.user_goal
        if situation.held is not None or goal is None or goal.identity != self._pursued:
            self._pursued, self._lost_since_ns = goal.identity if goal is not None else "", None
        if situation.held is not None:
            return MissionState.HELD, situation.held.words()
        if goal is None or goal.identity == self.given_up:
            return None
        lost = situation.slam_state is TrackingState.LOST and goal.frame != "odom"
        if not lost or self._lost_since_ns is None:
            self._lost_since_ns = now_ns if lost else None
        elif now_ns > self._lost_since_ns + _LOST_WAIT_NS:
            self.given_up, self._lost_since_ns = goal.identity, None
            self._log.note(now_ns, f"the goal of {goal.client} is given up: {situation.slam_reason or 'tracking lost'}")
            return None
        return MissionState.USER_GOAL, goal.words()
