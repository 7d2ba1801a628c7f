"""Commands whose work is done above the command line: ROS lives there, so this process becomes another program."""

from __future__ import annotations

import argparse
import os
import sys
from typing import NoReturn

from vsx_ros.cli.explore import live_arguments


def continue_as(module: str, args: argparse.Namespace) -> NoReturn:
    """Become ``python -m module`` with the options that were given. Nodes of this machine find each other as localhost
    unless told otherwise."""
    if not (os.environ.get("ROS_IP") or os.environ.get("ROS_HOSTNAME")):
        os.environ["ROS_HOSTNAME"] = "localhost"
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", module, *live_arguments(args)])
