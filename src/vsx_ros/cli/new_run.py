"""The code of scripts/new_run: prints a name for the folder of a run. Launch files call it, so that all their nodes
write to the same one."""

import sys
from datetime import datetime

from vsx_ros.errors import VsxError
from vsx_ros.runs.folder import RunFolder, dated
from vsx_ros.runs.parameters import ros_home


def new_run() -> str:
    """The path of a folder in $ROS_HOME/runs (~/.ros/runs) that no other launch has, to the microsecond. The nodes make
    it: roslaunch asks for its name, too, where it only lists a launch file. Empty, with a warning, if none can be made:
    a robot drives with a full disk, too."""
    path = dated(f"{datetime.now():%f}_ros", ros_home() / "runs").resolve()
    try:
        RunFolder.check(path)
    except VsxError as error:
        sys.stderr.write(f"nothing of this run is kept: {error}\n")
        return ""
    return str(path)


def main() -> None:
    """Entry point."""
    sys.stdout.write(new_run())
