"""``vsx explore``: an autonomous exploration, live through the ROS nodes or in lock-step (``--fast``)."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsx_ros.cli import config
from vsx_ros.cli.compiled import compile_kernels
from vsx_ros.errors import ConfigError
from vsx_ros.registry import PLUGINS, Kinds

if TYPE_CHECKING:
    from vsx_ros.config import Config
    from vsx_ros.io.run_folder import RunFolder
    from vsx_ros.sim.world import World

DEFAULTS = {"seed": 1, "base": "auto", "port": "/dev/kobuki", "camera": "kinect", "rate": 15.0, "planner": "fov"}
REMEMBERED = ("world", "seed", "base", "port", "camera", "rate", "planner", "time", "until", "fast", "load_map")


BASES = Kinds(("auto", "kobuki", "create", "create2", "ros"))
PLANNERS = Kinds(("fov", "unconstrained"))


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "explore",
        help="explore and map by itself: a real robot, or an emulated one with --world",
        description="An autonomous exploration. With --world the emulator stands in for the robot under the real "
        "drivers; without it, real devices are used.",
        epilog="examples: vsx explore --world lab --seed 1 --time 240   |   vsx explore --base kobuki --port "
        "/dev/kobuki   |   vsx explore --fast --seed 1   |   vsx explore --resume runs/today",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def add_arguments(parser: argparse.ArgumentParser, *, with_load_map: bool = True) -> None:
    """The options that the live run and the lock-step run share; without --load-map where the map is given."""
    parser.add_argument(
        "--world", metavar="NAME|FILE", help="emulate: lab, office, corridor, building, a world.yaml, map.yaml or .png"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="world and noise of the emulator (default 1)")
    parser.add_argument(
        "--base",
        choices=BASES,
        metavar="auto|kobuki|create|create2|ros[:ODOM,CMD_VEL]",
        help="kind of base (default: the one that answers); ros: any base with a ROS driver of its own, by its topics "
        "odom and cmd_vel or those named",
    )
    parser.add_argument("--port", metavar="DEV", help="serial port of the base (default /dev/kobuki)")
    parser.add_argument(
        "--camera",
        type=camera,
        metavar="kinect|v4l:N|ros[:TOPIC]",
        help="where the pictures come from (default kinect); ros: the images of another driver, as "
        "camera/rgb/image_raw or on that topic, raw or compressed",
    )
    parser.add_argument(
        "--rate", type=rate, metavar="HZ", help="images a second of a live emulated camera (default 15)"
    )
    parser.add_argument("--planner", choices=PLANNERS, metavar="fov|unconstrained", help="motion planner (default fov)")
    parser.add_argument("--phi", type=float, metavar="RAD_PER_M", help="bound on the change of view per metre")
    parser.add_argument(
        "--time",
        type=float,
        metavar="S",
        help="stop after this time, the whole run's if resumed (default: none; with --fast 600)",
    )
    parser.add_argument(
        "--until",
        type=share,
        metavar="SHARE",
        help="stop when this share of what can be seen of an emulated world is known and right, e.g. 0.9",
    )
    parser.add_argument(
        "--resume", type=Path, metavar="RUN", help="go on with an interrupted run, in its map and with its options"
    )
    parser.add_argument("--moved", action="store_true", help="with --resume: the robot was carried elsewhere meanwhile")
    if with_load_map:
        parser.add_argument(
            "--load-map", metavar="FILE", help="go on in a SLAM map (.vsxmap), the robot anywhere in it: 'vsx map save'"
        )
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
    if args.until is not None and ((args.world is None and args.resume is None and not args.fast) or args.load_map):
        raise ConfigError(
            f"--until {args.until:g}: how much is right is known of an emulated world and a new map alone"
        )
    _refuse_wires(args)
    compile_kernels()
    if args.fast:
        from vsx_ros.cli.explore_fast import explore_fast

        return explore_fast(args)
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "vsx_ros.ros", *live_arguments(args)])


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


def begin(args: argparse.Namespace) -> tuple[RunFolder, Config, World | None]:
    """The run folder, its configuration, and the emulated world if there is one; what was not said becomes the default,
    or what the run to resume had. Nothing is written before all of it is known to be right.

    Raises InputError, ConfigError or MapFileError when there is no such run, world or map, or an option contradicts it.
    """
    from vsx_ros.cli.robot_file import robot_file_here
    from vsx_ros.cli.world import open_world
    from vsx_ros.config import overridden
    from vsx_ros.io.atomic import sync
    from vsx_ros.io.run_folder import RunFolder
    from vsx_ros.io.slam_map_file import load_slam_map
    from vsx_ros.sim.world_file import save_world

    if args.resume is not None:
        return _begin_again(args, RunFolder.open(args.resume))
    if args.moved:
        raise ConfigError("--moved is said of the robot of an interrupted run; give that run with --resume, too")
    command = ["vsx", "explore", *(["--fast"] if args.fast else []), *live_arguments(args)]
    fill(args, DEFAULTS)
    if args.fast:
        fill(args, {"world": "lab"})
    if args.load_map is not None:
        args.load_map = str(Path(args.load_map).resolve())
        if not Path(args.load_map).is_file():
            raise ConfigError(f"there is no map {args.load_map}; 'vsx map save' makes one")
        load_slam_map(Path(args.load_map))
    if args.config is None and args.world is None:
        args.config = robot_file_here()
    parameters = config.load(args.config, args.set)
    if args.phi is not None:
        parameters = overridden(parameters, {"planner.phi_rad_m": args.phi})
    world = open_world(args.world, args.seed) if args.world else None
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    usual = Path("runs") / f"{now}_{Path(args.world).stem if args.world else args.base.partition(':')[0]}"
    folder = RunFolder.create(args.out) if args.out else RunFolder.create_another(usual)
    folder.write_config(parameters, command, **{name: getattr(args, name) for name in REMEMBERED})
    if world is not None:
        save_world(world, folder.path / "world.yaml")
        sync(folder.path / "world.yaml")
    return folder, parameters, world


def fill(args: argparse.Namespace, values: Mapping[str, Any]) -> None:
    """Give the options that were not given these values."""
    for name, value in values.items():
        if getattr(args, name) is None:
            setattr(args, name, value)


def _begin_again(args: argparse.Namespace, folder: RunFolder) -> tuple[RunFolder, Config, World | None]:
    from vsx_ros.cli.session import end_the_trail
    from vsx_ros.sim.world_file import load_world

    fixed = ("world", "seed", "base", "planner", "phi", "load_map", "config", "set", "out")
    contradicting = [name.replace("_", "-") for name in fixed if getattr(args, name) not in (None, [])]
    if contradicting:
        raise ConfigError(f"--resume goes on with the options of {folder.path}; leave out --{contradicting[0]}")
    parameters, facts = folder.read_config()
    if "fast" not in facts:
        raise ConfigError(f"{folder.path} is no run of 'vsx explore'; a replay is begun anew")
    if facts["fast"] is not args.fast:
        how = "with" if facts["fast"] else "without"
        raise ConfigError(f"{folder.path} was made {how} --fast; resume it so, too")
    fill(args, {name: facts.get(name) for name in REMEMBERED})
    fill(args, DEFAULTS)
    world = load_world(folder.path / "world.yaml") if args.world else None
    if args.moved and world is not None:
        raise ConfigError(f"the emulated robot of {folder.path} stands where it stood; leave out --moved")
    if not args.fast:
        end_the_trail(folder, args.moved)
    return folder, parameters, world


def live_arguments(args: argparse.Namespace) -> list[str]:
    """The command line of ``python -m vsx_ros.ros`` that says the same."""
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
