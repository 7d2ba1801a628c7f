"""What operator and dock ask of the mission."""

import threading
from collections.abc import Callable
from functools import partial

import rospy

from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import DOCK, OPERATOR, MissionState, Outcome
from vsx_ros.exploration.mission import Mission
from vsx_ros.ros import topics
from vsx_ros.ros.callbacks import offer_trigger_by

Request = Callable[[int, str], None]


class MissionRequests:
    """Services: explore/{pause,resume,stop,home}. They answer at once, also while the mission chooses a view: it gets
    one request before each decision, so that it decides on a pause before it hears of its end. But the base stands from
    the answer on."""

    def __init__(self, mission: Mission, stand: Callable[[], None]) -> None:
        """stand: ends the mission's drive."""
        self._mission, self._stand = mission, stand
        self._lock = threading.Lock()
        self._waiting: list[tuple[Request, str]] = []
        for name, request, answer in (
            (topics.EXPLORE_PAUSE, mission.pause, "the robot stands until the exploration is resumed"),
            (topics.EXPLORE_RESUME, mission.resume, "the exploration goes on"),
            (topics.EXPLORE_STOP, mission.stop, "the exploration ends here"),
            (topics.EXPLORE_HOME, mission.home, "the robot drives home, then the exploration ends"),
        ):
            offer_trigger_by(name, partial(self._ask, request, answer))

    def _ask(self, request: Request, answer: str, node: str) -> str:
        """node: that asks; the dock asks for itself, any other for the operator."""
        by = DOCK if node == rospy.resolve_name("dock") else OPERATOR
        with self._lock:
            others = self._pausers() - {by}
            self._waiting.append((request, by))
            if self._is_to_stand():
                self._stand()
        answer += ", when the operator lets go of the wheels" if self._mission.state is MissionState.HELD else ""
        return f"{answer}; {others.pop()} has paused it, too" if others else answer

    def _pausers(self) -> set[str]:
        """Who has paused, when the mission has heard all. Raises InputError if the exploration is over then."""
        pausers = set(self._mission.paused_by)
        outcome = self._mission.outcome
        for request, by in self._waiting:
            if request == self._mission.stop:
                outcome = outcome or Outcome.STOPPED
            elif request == self._mission.pause:
                pausers.add(by)
            elif request == self._mission.resume:
                pausers.discard(by)
        if outcome is not None:
            raise InputError(f"the exploration is over: {outcome.value}")
        return pausers

    def _is_to_stand(self) -> bool:
        return any(request in (self._mission.pause, self._mission.stop) for request, _ in self._waiting)

    def send_home(self, by: str) -> None:
        """As the service, for this node itself."""
        with self._lock:
            self._waiting.append((self._mission.home, by))

    def tell_next(self, now_ns: int) -> None:
        """Tell the mission the oldest request that it has not heard; the caller holds the mission's lock."""
        with self._lock:
            if self._waiting:
                request, by = self._waiting.pop(0)
                request(now_ns, by)

    def unless_to_stand(self, act: Callable[[], None]) -> None:
        """Act on a decision, unless a pause or stop came while it was made; the mission forgets that drive when it
        hears of it."""
        with self._lock:
            if not self._is_to_stand():
                act()
