"""``vsx stop``: the emergency stop of the base, set and released."""

from __future__ import annotations

import argparse
from typing import Any


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "stop",
        help="emergency stop: the wheels stand until it is released",
        description="Sets the emergency stop of the base, which no other command overrides and which outlives a "
        "restart of its node, and waits until the wheels stand. --release lets the robot drive again. A second robot "
        "is reached with ROS_NAMESPACE=robot1 vsx stop.",
        epilog="exit codes: 0 the wheels stand (or are free again), 1 no base can be reached, 2 it does not obey",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options, for here and for the program above."""
    parser.add_argument("--release", action="store_true", help="release the emergency stop")


def run(args: argparse.Namespace) -> int:
    """Continue where ROS is."""
    from vsx_ros.cli.above import continue_as

    continue_as("vsx_ros.ros.stop", args)
