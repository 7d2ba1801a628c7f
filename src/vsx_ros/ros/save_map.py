"""The map of a running robot behind ``vsx map save``."""

from __future__ import annotations

import sys
from pathlib import Path

import rospy
from std_srvs.srv import Trigger

from vsx_ros.errors import ConfigError, MapFileError
from vsx_ros.ros import calls, operator_command, topics
from vsx_ros.runs.exit_codes import DONE

_WAIT_S, _SAVED_S = 5.0, 120.0
"""The map of a large building is 120 MB, and its disk may be slow."""


@operator_command.command
def save_map(out: Path | None) -> int:
    """Ask vslam to save its map, and say where it is. out: where, else where the node finds best.

    Raises ConfigError when no robot maps, MapFileError when the map cannot be saved.
    """
    operator_command.join("save_map")
    try:
        rospy.wait_for_service(topics.SAVE_MAP, timeout=_WAIT_S)
        rospy.set_param(topics.SAVE_MAP_TO, str(out.resolve()) if out is not None else "")
        answer = calls.service(topics.SAVE_MAP, Trigger, within_s=_SAVED_S)
    except (rospy.ROSException, rospy.ServiceException) as error:
        name = rospy.resolve_name(topics.SAVE_MAP)
        raise ConfigError(
            f"nobody offers {name} ({error}); start the robot, or save the map of a run: 'vsx map save RUN'"
        ) from error
    if not answer.success:
        raise MapFileError(answer.message)
    sys.stdout.write(f"{answer.message}\n")
    return DONE
