"""``vsx stop``: emergency stop: the wheels stand until it is released

Sets the emergency stop of the base, which no other command overrides and which outlives a restart of its node, and
waits until the wheels stand. --release lets the robot drive again. A second robot is reached with ROS_NAMESPACE=robot1
vsx stop.

exit codes: 0 the wheels stand (or are free again), 1 no base can be reached, 2 it does not obey
"""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--release", action="store_true", help="release the emergency stop")


def run(args: argparse.Namespace) -> int:
    """Set or release it."""
    from vsx_ros.ros.operator_command import stop

    return stop(release=args.release)
