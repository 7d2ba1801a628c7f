"""Which goal of somebody else move_base pursues, from what actionlib tells: goals as they are sent, and their
states."""

from collections.abc import Mapping
from typing import NamedTuple

from vsx_ros.exploration.decision import SECOND_NS
from vsx_ros.robot import UserGoal

_TAKEN_WITHIN_NS = 2 * SECOND_NS  # a goal that move_base does not list by then is lost


class GoalState(NamedTuple):
    """A goal in move_base's list. reason: its words, once it has ended."""

    live: bool
    reached: bool
    reason: str


class UserGoals:
    """The newest goal that is not ours. own: what the identities of ours begin with, as "/explore-"."""

    def __init__(self, *own: str) -> None:
        self._own = own
        self._listed = False
        self.current: UserGoal | None = None
        self.last_end = ""
        """How the last one has ended, for people."""

    def sent(self, now_ns: int, identity: str) -> None:
        """A goal was sent to move_base; it begins with the name of its client."""
        if identity and not identity.startswith(self._own):
            self.current, self._listed = UserGoal(identity, identity.split("-")[0], now_ns), False

    def told(self, now_ns: int, states: Mapping[str, GoalState]) -> None:
        """move_base's list of goals, by identity."""
        theirs = {identity: state for identity, state in states.items() if not identity.startswith(self._own)}
        live = [identity for identity, state in theirs.items() if state.live]
        now = self.current
        if now is not None and now.identity in theirs:
            self._listed = True
        late = now is not None and now_ns > now.since_ns + _TAKEN_WITHIN_NS
        if now is not None and now.identity not in live and (self._listed or late):
            self._end(now, theirs.get(now.identity))
        if self.current is None and live:
            self.sent(now_ns, live[-1])

    def _end(self, goal: UserGoal, state: GoalState | None) -> None:
        self.current = None
        if state is None:
            self.last_end = f"move_base does not know the goal of {goal.client} any more"
        elif state.reached:
            self.last_end = f"the goal of {goal.client} is reached"
        else:
            self.last_end = f"the goal of {goal.client} is not reached ({state.reason})"
