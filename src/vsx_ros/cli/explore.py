"""``vsx explore``: a map from a robot that explores. What takes long to import is imported beside the fork server."""

import argparse
import sys

from vsx_ros.cli.compiled import DRIVE, compile_kernels
from vsx_ros.errors import ConfigError
from vsx_ros.runs.parameters import load
from vsx_ros.runs.start import check_files
from vsx_ros.runs.world import check_world
from vsx_ros.sim.hard_things import named_things
from vsx_ros.sim.mitsuba_variant import SLOWLY, is_fast, mitsuba


def explore(args: argparse.Namespace) -> int:
    """Explore in lock-step or live."""
    if args.fast and args.view:
        raise ConfigError("--view shows the live nodes, and --fast runs none; leave out one of the two")
    if args.until is not None and ((args.world is None and args.resume is None and not args.fast) or args.load_map):
        known = "how much is right is known of an emulated world and a new map alone"
        raise ConfigError(f"--until {args.until:g}: {known}")
    _refuse_wires(args)
    load(args.config, args.set)  # all that may be misspelt, before minutes of compiling
    if args.world is not None:
        check_world(args.world, args.models)
    named_things(args.hard, "--with")
    check_files(args)
    if args.eye == "mitsuba" and not is_fast(mitsuba()):
        print(f"vsx: {SLOWLY}", file=sys.stderr)
    if args.fast:
        from vsx_ros.runs.lockstep import explore_fast

        compile_kernels()
        return explore_fast(args)
    from vsx_ros.ros.environment import package_environment
    from vsx_ros.ros.fork_server import ForkServer

    package_environment()
    if (args.base or "").startswith("ros:"):
        from vsx_ros.ros.topic_base import topic_names

        topic_names(args.base)
    groups = *DRIVE, *(["emulation"] if args.world or args.resume else [])
    compile_kernels(*groups)
    with ForkServer(*groups) as forks:
        from vsx_ros.ros.run import explore

        return explore(args, forks)


def _refuse_wires(args: argparse.Namespace) -> None:
    """Raises ConfigError for options that only a real robot has, or only one with emulated devices."""
    if args.rate is not None and args.world is None and args.resume is None and not args.fast:
        raise ConfigError(f"--rate {args.rate:g} is for an emulated camera; give --world, or leave it out")
    for name in ("dock", "battery_pace"):
        if getattr(args, name) is not None and args.world is None and args.resume is None and not args.fast:
            option = f"--{name.replace('_', '-')} {getattr(args, name)}"
            raise ConfigError(f"{option} is for an emulated world; give --world, or leave it out")
    if args.eye is not None and not args.fast:
        raise ConfigError(f"--eye {args.eye} draws in lock-step alone; add --fast, or leave it out")
    if args.hard and args.world is None and not args.fast:
        raise ConfigError(f"--with {args.hard[0]} is for an emulated world; give --world, or leave it out")
    if args.models and args.world is None and args.resume is None:
        raise ConfigError(f"--models {args.models[0]} is for a Gazebo world; give --world, or leave it out")
    wires = "base", "port", "camera", "rate", "dock", "battery_pace"
    emulated, without = ("--fast", wires) if args.fast else ("--world", ("port", "camera"))
    for name in without if args.fast or args.world is not None else ():
        if getattr(args, name) is not None:
            no_meaning = f"has no meaning for the robot that {emulated} emulates; leave out one of the two"
            raise ConfigError(f"--{name.replace('_', '-')} {getattr(args, name)} {no_meaning}")
