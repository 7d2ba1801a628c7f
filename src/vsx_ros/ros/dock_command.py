"""The commands ``vsx dock`` and ``vsx undock``: ask the node dock, and wait until it rests."""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import rospy
from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.ros import operator_command, topics
from vsx_ros.ros.callbacks import json_object, subscribe
from vsx_ros.runs.process import DONE, FAILED, Progress

_ANSWER_S = 10.0  # it pauses the exploration first
_TICK_S = 0.1  # so that Ctrl-C takes effect at once


class _Heard:
    """status: the newest dock/status. begun, ended: what happened since; also when this thread is late and several come
    at once."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {}
        self.begun = self.ended = False
        subscribe(topics.DOCK_STATUS, String, self._on_status, queue_size=20)

    def _on_status(self, msg: String) -> None:
        self.status = json_object(msg, "state", "reason")
        rests = DockingState(self.status["state"]).rests
        self.begun, self.ended = self.begun or not rests, self.begun and rests


@operator_command.command
def dock(at: tuple[float, float, float] | None) -> int:
    """Drive onto the dock. at: x, y [m], heading [rad] of the charging base in the map; None: the remembered one.
    Raises ConfigError without a robot, InputError when it refuses."""
    operator_command.join("dock")
    wish = json.dumps({} if at is None else {"at": list(at)})
    return _pursued(lambda: _asked(topics.DOCK_START, AddDiagnostics, wish), DockingState.DOCKED)


@operator_command.command
def undock() -> int:
    """Leave the dock. Raises as ``dock``."""
    operator_command.join("undock")
    return _pursued(lambda: _asked(topics.DOCK_LEAVE, Trigger), DockingState.UNDOCKED)


def _asked(service: str, kind: type[Any], *arguments: object) -> str:
    remedy = "start the robot first: 'vsx explore'"
    return operator_command.asked(service, kind, *arguments, within_s=_ANSWER_S, remedy=remedy)


def _pursued(ask: Callable[[], str], wanted: DockingState) -> int:
    """Show what happens until it rests; Ctrl-C cancels it."""
    heard, progress = _Heard(), Progress(sys.stderr)
    progress.say(ask())
    try:
        while not rospy.is_shutdown() and not heard.ended:
            if progress.is_due and heard.begun:
                progress.show(f"{heard.status['state']}: {heard.status['reason']}")
            time.sleep(_TICK_S)
    except KeyboardInterrupt:
        _asked(topics.DOCK_CANCEL, Trigger)
        raise
    progress.clear()
    state, reason = heard.status.get("state"), heard.status.get("reason", "the ROS master has ended")
    (sys.stdout if state == wanted.value else sys.stderr).write(f"{state}: {reason}\n")
    return DONE if state == wanted.value else FAILED
