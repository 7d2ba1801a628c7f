"""What the operator's commands share: they join a running ROS graph for a moment and leave it as it was."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable
from typing import TypeVar

import rosgraph
import rospy

from vsx_hw.errors import DeviceError
from vsx_ros.cli import streams
from vsx_ros.cli.check_network import DEFAULT_MASTER
from vsx_ros.cli.exit_codes import DONE, FAILED, HARDWARE
from vsx_ros.errors import ConfigError, VsxError
from vsx_ros.ros import calls, logs
from vsx_ros.ros.master_watch import master_watch

Arguments = TypeVar("Arguments")

_LEAVE_S = 3.0


def join(name: str) -> None:
    """Be a node whose name nobody else has. Ctrl-C stays what it is in Python.

    Raises ConfigError when no master answers.
    """
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        raise ConfigError(
            f"no ROS master answers at {uri}, so no robot is running there (a base without its master stands still); "
            "start one with 'vsx explore' or roslaunch, or set ROS_MASTER_URI"
        )
    rospy.init_node(f"vsx_{name}", anonymous=True, disable_signals=True, disable_rosout=True)
    master_watch()


def command(work: Callable[[Arguments], int], arguments: Arguments) -> int:
    """The exit code of ``work``; errors are one sentence. Ctrl-C is how these commands are ended, hence no failure."""
    logs.quiet_failures()
    try:
        return streams.ended(work(arguments))
    except KeyboardInterrupt:
        return DONE
    except (VsxError, DeviceError) as error:
        sys.stderr.write(f"vsx: {error}\n")
        return HARDWARE if isinstance(error, DeviceError) else FAILED
    finally:
        with contextlib.suppress(calls.NoAnswer):
            calls.within(_LEAVE_S, lambda: rospy.signal_shutdown("the command is done"), "the ROS master")
