"""``vsx view``, ``status``, ``stop``, ``teleop`` and ``record``: what an operator does with a robot that runs."""

import argparse
import math
import sys

from vsx_ros.errors import ConfigError


def view(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    if args.port is not None and not 0 < args.port < 65536:
        raise ConfigError(f"--port {args.port}: give a number from 1 to 65535")
    from vsx_ros.ros.nodes.dashboard import view

    return view(args.host, args.port, args.allow, headless=args.headless)


def status(args: argparse.Namespace) -> int:
    """Listen and print."""
    from vsx_ros.ros.status import status

    return status(watch=args.watch, as_json=args.json)


def stop(args: argparse.Namespace) -> int:
    """Set or release the emergency stop."""
    from vsx_ros.ros.operator_command import stop

    return stop(release=args.release)


def teleop(args: argparse.Namespace) -> int:
    """Be the node until its end."""
    if not max(args.v, args.omega) < math.inf:
        raise ConfigError("--v and --omega: give finite numbers")
    if not sys.stdin.isatty():
        raise ConfigError("there is no keyboard; start teleop in a terminal of its own")
    from vsx_ros.ros.nodes.teleop import teleop

    return teleop(args.v, args.omega)


def record(args: argparse.Namespace) -> int:
    """Check what can be checked, and record."""
    if args.out is not None and args.out.exists():
        raise ConfigError(f"{args.out} exists; give another name, or delete it")
    if args.out is not None and not args.out.resolve().parent.is_dir():
        raise ConfigError(f"--out {args.out}: its folder does not exist; make it first")
    from vsx_ros.ros.record import record

    return record(args)
