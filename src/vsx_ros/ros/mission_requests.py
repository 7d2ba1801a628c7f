"""What operator and dock ask of the mission."""

import threading
from collections.abc import Callable
from functools import partial

import rospy

from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import DOCK, OPERATOR, MissionState
from vsx_ros.exploration.mission import Mission
from vsx_ros.ros import headers, topics
from vsx_ros.ros.callbacks import offer_trigger_by


class MissionRequests:
    """Services: explore/{pause,resume,stop,home}."""

    def __init__(self, mission: Mission, lock: threading.Lock) -> None:
        """lock: held while the mission is asked."""
        self._mission, self._lock = mission, lock
        for name, request, answer in (
            (topics.EXPLORE_PAUSE, mission.pause, "the robot stands until the exploration is resumed"),
            (topics.EXPLORE_RESUME, mission.resume, "the exploration goes on"),
            (topics.EXPLORE_STOP, mission.stop, "the exploration ends here"),
            (topics.EXPLORE_HOME, mission.home, "the robot drives home, then the exploration ends"),
        ):
            offer_trigger_by(name, partial(self._ask, request, answer))

    def _ask(self, request: Callable[[int, str], None], answer: str, node: str) -> str:
        """node: that asks; the dock asks for itself, any other for the operator."""
        by = DOCK if node == rospy.resolve_name("dock") else OPERATOR
        with self._lock:
            if self._mission.outcome is not None:
                raise InputError(f"the exploration is over: {self._mission.outcome.value}")
            request(headers.now_ns(), by)
            held, others = self._mission.state is MissionState.HELD, self._mission.paused_by - {by}
        answer += ", when the operator lets go of the wheels" if held else ""
        return f"{answer}; {others.pop()} has paused it, too" if others else answer
