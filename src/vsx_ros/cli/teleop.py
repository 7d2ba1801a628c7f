"""``vsx teleop``: drive with the keyboard

Drives while a key is held and stops when it is released. The keyboard wins over the exploration, which goes on half a
second after the last key; bumper and cliff sensors win over the keyboard.
"""

import argparse
import math
import sys

from vsx_ros.control.keyboard import KEYS
from vsx_ros.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.epilog = KEYS
    parser.add_argument("--v", type=float, default=0.2, metavar="M_S", help="speed ahead and back (default 0.2 m/s)")
    parser.add_argument("--omega", type=float, default=0.6, metavar="RAD_S", help="turn rate (default 0.6 rad/s)")


def run(args: argparse.Namespace) -> int:
    """Be the node until its end."""
    for name in ("v", "omega"):
        value = getattr(args, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigError(f"--{name} {value}: give a positive number")
    if not sys.stdin.isatty():
        raise ConfigError("there is no keyboard; start teleop in a terminal of its own")
    from vsx_ros.ros.nodes.teleop import teleop

    return teleop(args.v, args.omega)
