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
