"""``vsx status``: what a running robot does, and why

Listens for two to four seconds and prints state and reason of exploration and SLAM, the ratio of map points found, the
camera's rate, who drives the wheels, hazards and battery. What nobody says is shown as -, in JSON as null.

exit codes: 0 somebody answers, 1 nobody does
"""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--watch", action="store_true", help="print anew every second until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="one line of JSON each time")


def run(args: argparse.Namespace) -> int:
    """Listen and print."""
    from vsx_ros.ros.status import status

    return status(watch=args.watch, as_json=args.json)
