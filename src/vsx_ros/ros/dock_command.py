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

from vsx_ros.errors import ConfigError
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.ros import operator_command, topics
from vsx_ros.ros.callbacks import json_object, subscribe
from vsx_ros.runs.process import DONE, FAILED, Progress

_ANSWER_S = 10.0  # it pauses the exploration first
_TICK_S = 0.1  # so that Ctrl-C takes effect at once
_REMEDY = "start the robot first: 'vsx explore'"


class _Heard:
    """status: the newest dock/status, and whether its docking rests; empty before the first."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {}
        self._silent_ticks = 0
        subscribe(topics.DOCK_STATUS, String, self._on_status, queue_size=20)

    def _on_status(self, msg: String) -> None:
        status = json_object(msg, "state", "reason", "number")
        self.status = status | {"rests": DockingState(status["state"]).rests}
        self._silent_ticks = 0

    def wait(self) -> None:
        """A moment. Raises ConfigError when no status comes any more."""
        time.sleep(_TICK_S)
        self._silent_ticks += 1
        if self._silent_ticks * _TICK_S > _ANSWER_S and not rospy.is_shutdown():
            raise ConfigError(
                f"nobody has told {rospy.resolve_name(topics.DOCK_STATUS)} for {_ANSWER_S:g} s; {_REMEDY}"
            )


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
    return operator_command.asked(service, kind, *arguments, within_s=_ANSWER_S, remedy=_REMEDY)


def _pursued(ask: Callable[[], str], wanted: DockingState) -> int:
    """Show what happens until it rests; Ctrl-C cancels it. It may have ended before its first status: what is awaited
    is a status with another number than the one before it was asked for."""
    heard, progress = _Heard(), Progress(sys.stderr)
    while not heard.status and not rospy.is_shutdown():
        heard.wait()
    before = heard.status.get("number")
    progress.say(ask())
    try:
        while not rospy.is_shutdown():
            status = heard.status
            if (begun := status["number"] != before) and status["rests"]:
                break
            if progress.is_due and begun:
                progress.show(f"{status['state']}: {status['reason']}")
            heard.wait()
        else:
            status = {"state": "not known", "reason": "the ROS master has ended"}
    except KeyboardInterrupt:
        _asked(topics.DOCK_CANCEL, Trigger)
        raise
    finally:
        progress.clear()
    state, reason = status["state"], status["reason"] or "the node dock was started anew"
    (sys.stdout if state == wanted.value else sys.stderr).write(f"{state}: {reason}\n")
    return DONE if state == wanted.value else FAILED
