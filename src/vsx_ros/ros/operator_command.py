"""What the operator's commands share: they join a running ROS graph for a moment and leave it as it was."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Callable
from typing import ParamSpec

import rosgraph
import rospy

from vsx_ros.errors import ConfigError
from vsx_ros.ros import calls, logs
from vsx_ros.ros.host_address import DEFAULT_MASTER, export_ros_address
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs.exit_codes import DONE

P = ParamSpec("P")

_LEAVE_S = 3.0


def join(name: str) -> None:
    """Be a node whose name nobody else has. Ctrl-C stays what it is in Python.

    Raises ConfigError when no master answers.
    """
    export_ros_address()
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        raise ConfigError(
            f"no ROS master answers at {uri}, so no robot is running there (a base without its master stands still); "
            "start one with 'vsx explore' or roslaunch, or set ROS_MASTER_URI"
        )
    rospy.init_node(f"vsx_{name}", anonymous=True, disable_signals=True, disable_rosout=True)
    master_watch()


def command(work: Callable[P, int]) -> Callable[P, int]:
    """``work``, which joins, and leaves at its end. Ctrl-C is how these commands are ended, hence no failure."""

    @functools.wraps(work)
    def joining(*args: P.args, **options: P.kwargs) -> int:
        logs.quiet_failures()
        try:
            return work(*args, **options)
        except KeyboardInterrupt:
            return DONE
        finally:
            with contextlib.suppress(calls.NoAnswer):
                calls.within(_LEAVE_S, lambda: rospy.signal_shutdown("the command is done"), "the ROS master")

    return joining
