"""Commands whose work is done above the command line: ROS lives there, so this process becomes another program."""

from __future__ import annotations

import argparse
import os
import sys
from typing import NoReturn

from vsx_ros.cli.explore import live_arguments
from vsx_ros.cli.own_address import tell_ros


def continue_as(module: str, args: argparse.Namespace) -> NoReturn:
    """Become ``python -m module`` with the options that were given."""
    tell_ros()
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", module, *live_arguments(args)])
