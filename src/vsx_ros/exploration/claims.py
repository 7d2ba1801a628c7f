"""What comes before the mission: the operator's claims on the robot, and missing images. The mission yields, and goes
on when that is over. After a drive that somebody has cancelled it waits: who cancels wants the robot to stand."""

from typing import NamedTuple

from vsx_ros.exploration.decision import SECOND_NS, MissionState, NavigationState, Situation

_BLIND_S = 1.0  # more than slow images and a busy machine explain; the follower has stopped the base before


class Claim(NamedTuple):
    """The state that is asked for, why, and since when."""

    state: MissionState
    reason: str
    since_ns: int


class CancelWatch:
    """Notices that somebody else has ended the mission's drive."""

    def __init__(self) -> None:
        self._before = NavigationState.IDLE

    def seen(self, situation: Situation) -> tuple[Situation, str]:
        """The situation with that drive as a lost one: nothing is blamed. And what to say of a cancellation, once."""
        before, self._before = self._before, situation.navigation
        if situation.navigation not in (NavigationState.CANCELLED, NavigationState.REPLACED):
            return situation, ""
        is_new = situation.navigation is NavigationState.CANCELLED and before is not NavigationState.CANCELLED
        words = f"paused: somebody has cancelled the drive ({situation.navigation_reason}); resume to explore on"
        return situation._replace(navigation=NavigationState.LOST), words if is_new else ""


def claim_of(now_ns: int, situation: Situation) -> Claim | None:
    """The claim that counts; None without one. Held wheels come before a goal of the user's, and that before missing
    images."""
    held, goal, blind_s = situation.held, situation.user_goal, situation.blind_s
    if held is not None:
        return Claim(MissionState.HELD, held.words(), held.since_ns)
    if goal is not None:
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
    return situation.user_goal_end
