"""What comes before the mission: the operator's claims on the robot, and missing images. The mission yields, and goes
on when that is over."""

from typing import NamedTuple

from vsx_ros.exploration.decision import SECOND_NS, MissionLog, MissionState, Situation
from vsx_ros.slam.state import TrackingState

_LOST_WAIT_NS = 5 * SECOND_NS  # on the way to a goal of the user's, for the camera to be found by itself
_BLIND_S = 1.0  # more than slow images and a busy machine explain; the follower has stopped the base before


class Claim(NamedTuple):
    """The state that is asked for, why, and since when."""

    state: MissionState
    reason: str
    since_ns: int


class Claims:
    """Held wheels come before a goal of the user's, and that before missing images. given_up: identity of the last such
    goal that was given up; whoever pursues it is to end it."""

    def __init__(self, log: MissionLog) -> None:
        self._log = log
        self._lost_since_ns: int | None = None
        self._pursued = self.given_up = ""

    def of(self, now_ns: int, situation: Situation) -> Claim | None:
        """The claim that counts; None without one. A goal in the map of a camera that stays lost is no claim: it cannot
        be driven to before the camera is found."""
        goal, blind_s = situation.user_goal, situation.blind_s
        if situation.held is not None or goal is None or goal.identity != self._pursued:
            self._pursued, self._lost_since_ns = goal.identity if goal is not None else "", None
        if situation.held is not None:
            return Claim(MissionState.HELD, situation.held.words(), situation.held.since_ns)
        if goal is not None and goal.identity != self.given_up:
            lost = situation.slam_state is TrackingState.LOST and goal.frame != "odom"
            if not lost or self._lost_since_ns is None:
                self._lost_since_ns = now_ns if lost else None
            elif now_ns > self._lost_since_ns + _LOST_WAIT_NS:
                self.given_up, self._lost_since_ns = goal.identity, None
                why = situation.slam_reason or "tracking lost"
                self._log.note(now_ns, f"the goal of {goal.client} is given up: {why}")
                return None
            return Claim(MissionState.USER_GOAL, goal.words(), goal.since_ns)
        if blind_s > _BLIND_S:
            reason = "waiting for images: no word from vslam, which may have none"
            return Claim(MissionState.BLIND, reason, now_ns - round(blind_s * SECOND_NS))
        return None


def why_over(state: MissionState, situation: Situation) -> str:
    """What has ended the claim that asked for this state, for people."""
    if state is MissionState.BLIND:
        return "images come again"
    if state is MissionState.HELD:
        return "the operator has let go of the wheels"
    return situation.user_goal_end if situation.user_goal is None else "the goal is given up"
