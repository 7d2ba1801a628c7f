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
    parser.add_argument("--release", action="store_true", help="release the emergency stop")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Set or release it."""
    from vsx_ros.ros.operator_command import stop

    return stop(release=args.release)
