"""``vsx explore``: explore and map by itself: a real robot, or an emulated one with --world

An autonomous exploration. With --world the emulator stands in for the robot under the real drivers; without it, real
devices are used.

examples: vsx explore --world lab --seed 1 --time 240 | vsx explore --base kobuki --port /dev/kobuki | vsx explore
--fast --seed 1 | vsx explore --resume runs/today
"""

import argparse
import os
import re
from pathlib import Path

from vsx_ros.cli.compiled import compile_kernels
from vsx_ros.cli.config import add_parameters
from vsx_ros.errors import ConfigError
from vsx_ros.registry import PLUGINS, Kinds

BASES = Kinds(("auto", "kobuki", "create", "create2", "ros"))
PLANNERS = Kinds(("fov", "unconstrained"))


def add_arguments(parser: argparse.ArgumentParser, *, with_load_map: bool = True) -> None:
    """The options that the live run and the lock-step run share; without --load-map where the map is given."""
    _add_robot(parser)
    add = parser.add_argument
    add("--planner", choices=PLANNERS, metavar="fov|unconstrained", help="motion planner (default fov)")
    add("--phi", type=float, metavar="RAD_PER_M", help="bound on the change of view per metre")
    add(
        "--time",
        type=float,
        metavar="S",
        help="stop after this time, the whole run's if resumed (default: none; with --fast 600)",
    )
    add(
        "--until",
        type=share,
        metavar="SHARE",
        help="stop when this share of what can be seen of an emulated world is known and right, e.g. 0.9",
    )
    add("--resume", type=Path, metavar="RUN", help="go on with an interrupted run, in its map and with its options")
    add("--moved", action="store_true", help="with --resume: the robot was carried elsewhere meanwhile")
    if with_load_map:
        add(
            "--load-map", metavar="FILE", help="go on in a SLAM map (.vsxmap), the robot anywhere in it: 'vsx map save'"
        )
    add("--fast", action="store_true", help="one process, lock-step, no ROS, deterministic")
    add("--view", action="store_true", help="serve the live view, for a browser on this machine")
    add("--headless", action="store_true", help="open no window and no browser")
    add("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<world>)")
    add_parameters(parser)


def _add_robot(parser: argparse.ArgumentParser) -> None:
    """What drives and sees, emulated or real."""
    add = parser.add_argument
    add("--world", metavar="NAME|FILE", help="emulate: lab, office, corridor, building, a world.yaml, map.yaml or .png")
    add("--seed", type=int, metavar="N", help="world and noise of the emulator (default 1)")
    add(
        "--base",
        choices=BASES,
        metavar="auto|kobuki|create|create2|ros[:ODOM,CMD_VEL]",
        help="kind of base (default: the one that answers); ros: any base with a ROS driver of its own, by its topics "
        "odom and cmd_vel or those named",
    )
    add("--port", metavar="DEV", help="serial port of the base (default /dev/kobuki)")
    add(
        "--camera",
        type=camera,
        metavar="kinect|v4l:N|ros[:TOPIC]",
        help="where the pictures come from (default kinect); ros: the images of another driver, as "
        "camera/rgb/image_raw or on that topic, raw or compressed",
    )
    add("--rate", type=rate, metavar="HZ", help="images a second of a live emulated camera (default 15)")


def run(args: argparse.Namespace) -> int:
    """In lock-step, or live."""
    if args.time is not None and not args.time > 0:
        raise ConfigError(f"--time {args.time}: give a positive number of seconds")
    if args.fast and args.view:
        raise ConfigError("--view shows the live nodes, and --fast runs none; leave out one of the two")
    if args.until is not None and ((args.world is None and args.resume is None and not args.fast) or args.load_map):
        raise ConfigError(
            f"--until {args.until:g}: how much is right is known of an emulated world and a new map alone"
        )
    _refuse_wires(args)
    if args.fast:
        from vsx_ros.runs.lockstep import explore_fast

        compile_kernels()
        return explore_fast(args)
    from vsx_ros.ros.launch import package_environment

    package_environment()  # before minutes of compiling
    compile_kernels()
    from vsx_ros.ros.run import explore

    return explore(args)


def camera(text: str) -> str:
    """What the node camera takes as its ~device."""
    known = re.fullmatch(r"kinect(:.+)?|v4l:\d+|emulator:.+|ros(:[\w/~]+)?", text)
    if not known and not os.environ.get(PLUGINS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no camera; write kinect, kinect:SERIAL, v4l:N (e.g. v4l:0), ros or ros:TOPIC"
        )
    return text


def rate(text: str) -> float:
    """Images a second."""
    if not 1.0 <= float(text) <= 60.0:
        raise argparse.ArgumentTypeError(f"{text} images a second; give 1 to 60")
    return float(text)


def share(text: str) -> float:
    """Of a whole."""
    if not 0.0 < float(text) <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no share of a whole; give more than 0 and at most 1, e.g. 0.9")
    return float(text)


def _refuse_wires(args: argparse.Namespace) -> None:
    """Raises ConfigError for what only a real robot has, or only one with emulated wires."""
    if args.rate is not None and args.world is None and args.resume is None and not args.fast:
        raise ConfigError(f"--rate {args.rate:g} is for an emulated camera; give --world, or leave it out")
    emulated, without = ("--fast", ("base", "port", "camera", "rate")) if args.fast else ("--world", ("port", "camera"))
    for name in without if args.fast or args.world is not None else ():
        if getattr(args, name) is not None:
            given = f"--{name} {getattr(args, name)}"
            raise ConfigError(
                f"{given} has no meaning for the robot that {emulated} emulates; leave out one of the two"
            )
