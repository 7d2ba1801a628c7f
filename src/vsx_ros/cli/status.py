"""``vsx status``: what the robot does and why, on one screen."""

from __future__ import annotations

import argparse
from typing import Any


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "status",
        help="what a running robot does, and why",
        description="Listens for two to four seconds and prints state and reason of exploration and SLAM, the ratio of "
        "map points found, the camera's rate, who drives the wheels, hazards and battery. What nobody says is shown as "
        "-, in JSON as null.",
        epilog="exit codes: 0 somebody answers, 1 nobody does",
    )
    parser.add_argument("--watch", action="store_true", help="print anew every second until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="one line of JSON each time")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Listen and print."""
    from vsx_ros.ros.status import status

    return status(watch=args.watch, as_json=args.json)
