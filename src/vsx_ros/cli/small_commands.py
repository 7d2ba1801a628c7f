"""The small commands: ``vsx view``, ``status``, ``stop``, ``teleop``, ``go``, ``dock``, ``undock`` and ``record`` for a
running robot; also ``config`` and ``completion``."""

import argparse
import math
import sys
from typing import Any

from vsx_ros.errors import ConfigError

_ZSH_FIRST = "autoload -U compinit; (( $+functions[compdef] )) || compinit -u\n"


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
    """Run the node until it ends."""
    if not max(args.v, args.omega) < math.inf:
        raise ConfigError("--v and --omega: give finite numbers")
    if not sys.stdin.isatty():
        raise ConfigError("there is no keyboard; start teleop in a terminal of its own")
    from vsx_ros.ros.nodes.teleop import teleop

    return teleop(args.v, args.omega)


def go(args: argparse.Namespace) -> int:
    """Send the robot there."""
    from vsx_ros.ros.go import go

    return go(*args.place, stay=args.stay)


def dock(args: argparse.Namespace) -> int:
    """Send the robot to its dock."""
    from vsx_ros.ros.dock_command import dock

    return dock(args.at)


def undock(_: argparse.Namespace) -> int:
    """Let the robot leave its dock."""
    from vsx_ros.ros.dock_command import undock

    return undock()


def record(args: argparse.Namespace) -> int:
    """Check the options and record."""
    if args.out is not None and args.out.exists():
        raise ConfigError(f"{args.out} exists; give another name, or delete it")
    if args.out is not None and not args.out.resolve().parent.is_dir():
        raise ConfigError(f"--out {args.out}: its folder does not exist; make it first")
    from vsx_ros.ros.record import record

    return record(args)


def config(args: argparse.Namespace) -> int:
    """Print the parameters. Raises ConfigError for two files at once."""
    from vsx_ros.runs.parameters import commented_yaml, load, robot_file_here

    if args.robot and args.config is not None:
        raise ConfigError("--robot is the file that 'vsx calibrate' writes, --config another; leave out one")
    file = robot_file_here() if args.robot else args.config
    print(commented_yaml(load(file, args.set)), end="")
    return 0


def completion(args: argparse.Namespace) -> int:
    """Print the script."""
    from vsx_ros.cli.main import parser

    print(script(parser(), args.shell))
    return 0


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for bash or zsh: commands, options and their choices; file names for all other values."""
    import shtab

    _prepare(parser, shtab.FILE)
    return (_ZSH_FIRST if shell == "zsh" else "") + shtab.complete(parser, shell)


def _prepare(parser: argparse.ArgumentParser, file: Any) -> None:
    for action in parser._actions:
        if isinstance(action.metavar, str):
            action.metavar = action.metavar.replace(":", " ")  # shtab does not escape it for zsh
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _prepare(below, file)
        elif action.choices is None and action.nargs != 0:
            action.complete = file  # type: ignore[attr-defined]  # read by shtab
