"""The services behind the buttons of the page, and those that take a text."""

from typing import Any

import rospy
from diagnostic_msgs.srv import AddDiagnostics
from std_srvs.srv import SetBool, Trigger

from vsx_ros.ros import calls, topics
from vsx_ros.ros.dashboard.server import Answer, Command

_SERVICE_WAIT_S = 2.0  # then the button reports no answer


def commands() -> dict[str, Command]:
    """By the name in ``POST /command/NAME``. Those that take a text get it as JSON after a question mark, percent-
    encoded: ``/command/zones?{"remove": "carpet"}``."""
    return {
        "pause": _call(topics.EXPLORE_PAUSE, Trigger),
        "resume": _call(topics.EXPLORE_RESUME, Trigger),
        "home": _call(topics.EXPLORE_HOME, Trigger),
        "stop": _call(topics.EXPLORE_STOP, Trigger),
        "estop": _call(topics.ESTOP, SetBool, True, said="the wheels stand until the emergency stop is released"),
        "release": _call(topics.ESTOP, SetBool, False, said="the robot may drive"),
        "dock": _call(topics.DOCK_START, AddDiagnostics, "{}"),
        "undock": _call(topics.DOCK_LEAVE, Trigger),
        "zones?": _tell(topics.CHANGE_ZONES),
        "name-room?": _tell(topics.NAME_ROOM),
    }


def _call(service: str, kind: type[Any], *arguments: object, said: str = "") -> Command:
    return lambda: answer_of(service, kind, *arguments, said=said)


def _tell(service: str) -> Command:
    return lambda text: answer_of(service, AddDiagnostics, text)


def answer_of(
    service: str, kind: type[Any], *arguments: object, said: str = "", within_s: float = _SERVICE_WAIT_S
) -> Answer:
    """What a service answers. said: in place of its own words, when it has obeyed."""
    try:
        response = calls.service(service, kind, *arguments, within_s=within_s)
    except (rospy.ROSException, rospy.ServiceException):
        late = f"has not answered in {within_s:g} s; is its node running? A busy one may still do it"
        return Answer(False, f"service {rospy.resolve_name(service)} {late}")
    return Answer(bool(response.success), said if said and response.success else str(response.message))
