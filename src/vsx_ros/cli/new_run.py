"""The code of scripts/new_run: makes a folder for a run and prints it. Launch files call it, so that all their nodes
write to the same one."""

import sys

from vsx_ros.errors import VsxError
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.parameters import ros_home


def new_run() -> str:
    """The path of a new folder in $ROS_HOME/runs (~/.ros/runs). Empty, with a warning, if none can be made: a robot
    drives with a full disk, too."""
    try:
        return str(RunFolder.create_dated("ros", ros_home() / "runs").path.resolve())
    except VsxError as error:
        sys.stderr.write(f"nothing of this run is kept: {error}\n")
        return ""


def main() -> None:
    """Entry point."""
    sys.stdout.write(new_run())
