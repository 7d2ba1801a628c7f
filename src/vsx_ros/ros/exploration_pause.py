"""The exploration stands while the base docks, charges and undocks."""

import math
import threading
import time

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import DOCK, MissionState
from vsx_ros.ros import calls, topics
from vsx_ros.ros.callbacks import json_object, subscribe

_ANSWER_S = 5.0
_GONE_S = 3.0  # an exploration that says nothing for so long has ended: it repeats its status each second
_DRIVES = {state.value for state in (MissionState.STARTING, MissionState.MAPPING, MissionState.RECOVERING)}


class ExplorationPause:
    """Subscribers: explore/status. Pauses the exploration, if there is one, and lets it go on afterwards; whoever else
    has paused it resumes it himself. Call ``keep`` now and then: an exploration that was restarted is paused again, and
    a restarted node remembers by the status that it has paused. began_here: it had not driven yet then. inherited: the
    pause is of a node before this one, and nobody has asked this one for anything since."""

    def __init__(self) -> None:
        self._state, self._heard_s, self._paused = "", -math.inf, False
        self._wanted: bool | None = None
        self._changes = threading.Lock()
        self.began_here = self.inherited = False
        subscribe(topics.EXPLORE_STATUS, String, self._on_status, queue_size=1)

    def _on_status(self, msg: String) -> None:
        status = json_object(msg, "state")
        self._state, self._heard_s = str(status["state"]), time.monotonic()
        pausers = status.get("paused_by")
        self._paused = isinstance(pausers, list) and DOCK in pausers
        if self._wanted is None:
            self._wanted = self.inherited = self._paused

    @property
    def drives(self) -> bool:
        """Whether an exploration sends goals."""
        return self._state in _DRIVES and self._is_there

    @property
    def _is_there(self) -> bool:
        return self._state not in ("", MissionState.DONE.value) and time.monotonic() - self._heard_s < _GONE_S

    def begin(self) -> None:
        """Pause. Raises InputError if the exploration is there and does not pause: two would drive at once."""
        with self._changes:
            self.began_here = self._state == MissionState.STARTING.value
            if self._is_there and not self._asked(topics.EXPLORE_PAUSE):
                raise InputError("the exploration does not pause; end it with 'vsx stop', then ask again")
            self._wanted, self.inherited = True, False

    def end(self, inherited: bool = False) -> None:
        """Go on, if this has paused it. inherited: only if the pause is inherited."""
        with self._changes:
            if inherited and not self.inherited:
                return
            if self._wanted and self._is_there:
                self._asked(topics.EXPLORE_RESUME)
            self._wanted = self.inherited = False

    def keep(self) -> None:
        """Ask again where the exploration is not as it should be."""
        with self._changes:
            if self._wanted is not None and self._wanted != self._paused and self._is_there:
                self._asked(topics.EXPLORE_PAUSE if self._wanted else topics.EXPLORE_RESUME)

    def _asked(self, service: str) -> bool:
        try:
            return bool(calls.service(service, Trigger, within_s=_ANSWER_S).success)
        except (rospy.ROSException, rospy.ServiceException) as error:
            rospy.logwarn("%s: %s", service, error)
            return False
