"""``vsx zone`` and ``vsx room`` beside a running robot: its services for zones and rooms, and its latched topics."""

import sys
from typing import Any

import rospy
from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String

from vsx_ros.errors import ConfigError, InputError
from vsx_ros.ros import calls, topics
from vsx_ros.ros.callbacks import json_object
from vsx_ros.ros.operator_command import command, join
from vsx_ros.runs.process import DONE

_WITHIN_S = 5.0


def change_zones(change: str) -> int:
    """Add or remove zones; ``change`` is what the service zones/change takes. Raises as ``name_room``."""
    return _told(topics.CHANGE_ZONES, change)


def name_room(naming: str) -> int:
    """Name a room; ``naming`` is what the service rooms/name takes. Raises ConfigError without a robot, InputError when
    it refuses."""
    return _told(topics.NAME_ROOM, naming)


@command
def _told(service: str, text: str) -> int:
    join("places")
    try:
        answer = calls.service(service, AddDiagnostics, text, within_s=_WITHIN_S)
    except (rospy.ROSException, rospy.ServiceException) as error:
        name = rospy.resolve_name(service)
        raise ConfigError(f"nobody offers {name} ({error}); start the robot, or give a saved map with --map") from error
    if not answer.success:
        raise InputError(str(answer.message))
    sys.stdout.write(f"{answer.message}\n")
    return DONE


def heard(topic: str) -> dict[str, Any]:
    """What a latched topic says, as a tree. Raises ConfigError when nobody publishes it."""
    found: dict[str, Any] = {}

    @command
    def listen() -> int:
        join("places")
        try:
            found.update(json_object(rospy.wait_for_message(topic, String, timeout=_WITHIN_S)))
        except rospy.ROSException as error:
            name = rospy.resolve_name(topic)
            raise ConfigError(f"nobody tells {name}; start the robot, or give a saved map with --map") from error
        return DONE

    listen()
    return found
