"""``vsx zone`` and ``vsx room`` beside a running robot: its services for zones and rooms, and its latched topics."""

import sys
from typing import Any

import rospy
from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String

from vsx_ros.errors import ConfigError
from vsx_ros.ros import topics
from vsx_ros.ros.callbacks import json_object
from vsx_ros.ros.operator_command import asked, command, join
from vsx_ros.runs.process import DONE

_WITHIN_S, _REMEDY = 5.0, "start the robot, or give a saved map with --map"


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
    sys.stdout.write(f"{asked(service, AddDiagnostics, text, within_s=_WITHIN_S, remedy=_REMEDY)}\n")
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
            raise ConfigError(f"nobody tells {name}; {_REMEDY}") from error
        return DONE

    listen()
    return found
