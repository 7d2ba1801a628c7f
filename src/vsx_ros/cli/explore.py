"""``vsx explore``: an autonomous exploration, live through the ROS nodes or in lock-step (``--fast``)."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from vsx_ros.cli import config
from vsx_ros.errors import ConfigError


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "explore",
        help="explore and map by itself: a real robot, or an emulated one with --world",
        description="An autonomous exploration. With --world the emulator stands in for the robot under the real "
        "drivers; without it, real devices are used.",
        epilog="examples: vsx explore --world lab --seed 1 --time 240   |   vsx explore --base kobuki --port "
        "/dev/kobuki   |   vsx explore --fast --seed 1",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that the live run and the lock-step run share."""
    parser.add_argument(
        "--world", metavar="NAME|FILE", help="emulate: lab, office, corridor, a world.yaml or a map.yaml"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="world and noise of the emulator (default 1)")
    parser.add_argument("--base", choices=("kobuki", "create", "create2"), default="kobuki", help="kind of base")
    parser.add_argument("--port", default="/dev/kobuki", metavar="DEV", help="serial port of the base")
    parser.add_argument("--camera", default="kinect", metavar="kinect|v4l:N", help="where the pictures come from")
    parser.add_argument("--planner", choices=("fov", "unconstrained"), default="fov", help="motion planner")
    parser.add_argument("--phi", type=float, metavar="RAD_PER_M", help="bound on the change of view per metre")
    parser.add_argument("--time", type=float, metavar="S", help="stop after this time")
    parser.add_argument("--fast", action="store_true", help="one process, lock-step, no ROS, deterministic")
    parser.add_argument("--view", action="store_true", help="serve the live view, for a browser on this machine")
    parser.add_argument("--headless", action="store_true", help="open no window and no browser")
    parser.add_argument("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<world>)")
    config.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Lock-step here; the live run in a process of its own, because ROS lives above the command line."""
    if args.time is not None and not args.time > 0:
        raise ConfigError(f"--time {args.time}: give a positive number of seconds")
    if args.fast and args.view:
        raise ConfigError("--view shows the live nodes, and --fast runs none; leave out one of the two")
    if args.fast:
        from vsx_ros.cli.explore_fast import explore_fast

        return explore_fast(args)
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "vsx_ros.ros.run", *live_arguments(args)])


def live_arguments(args: argparse.Namespace) -> list[str]:
    """The command line of ``python -m vsx_ros.ros.run`` that says the same."""
    words: list[str] = []
    for name, value in vars(args).items():
        option = f"--{name.replace('_', '-')}"
        if name in ("run", "command", "debug", "fast") or value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, list):
            words += [word for item in value for word in (option, item)]
        else:
            words += [option, str(value)]
    return words
