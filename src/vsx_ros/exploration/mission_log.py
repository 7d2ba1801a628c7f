"""The log of a mission: the state it is in, every choice with its reason, and how it ended."""

from __future__ import annotations

from vsx_ros.exploration.decision import MissionEvent, MissionState, Outcome


class MissionLog:
    """state: the box of the diagram the mission is in. outcome: how it ended, if it has. reason: of the last entry."""

    def __init__(self) -> None:
        self.state = MissionState.STARTING
        self.outcome: Outcome | None = None
        self.reason = ""
        self._events: list[MissionEvent] = []

    def enter(self, now_ns: int, state: MissionState, reason: str) -> None:
        """From now on in this state."""
        self.state = state
        self.note(now_ns, reason)

    def note(self, now_ns: int, reason: str) -> None:
        """A choice."""
        self.reason = reason
        self._events.append(MissionEvent(now_ns, self.state.value, reason))

    def finish(self, now_ns: int, outcome: Outcome, reason: str) -> None:
        """The end; what ends later changes nothing."""
        if self.state is not MissionState.DONE:
            self.outcome = outcome
            self.enter(now_ns, MissionState.DONE, reason)

    def drain(self) -> list[MissionEvent]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events
