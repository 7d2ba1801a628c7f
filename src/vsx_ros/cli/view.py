"""``vsx view``: watch a running robot in a browser

Serves one page with the camera and the points it is tracked by, the map with frontiers, plan and robot, the state with
its reason, and buttons. Waits for a stack and outlives it; Ctrl-C ends the view, not the robot. The address it prints
holds the token that the buttons need: without it one can only look.

examples: vsx view | vsx view --host 0.0.0.0 (whoever reaches this machine can look)
"""

import argparse

from vsx_ros.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add = parser.add_argument
    add("--host", default="127.0.0.1", metavar="ADDRESS", help="listen here (default: this machine)")
    add("--port", type=int, metavar="N", help="listen here (default 8765, another one if that is taken)")
    add(
        "--allow",
        default="",
        metavar="NAMES",
        help="answer to these names, too, NAME or NAME:PORT, by commas (default: those of this machine)",
    )
    add("--headless", action="store_true", help="open no browser")


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    if args.port is not None and not 0 < args.port < 65536:
        raise ConfigError(f"--port {args.port}: give a number from 1 to 65535")
    from vsx_ros.ros.view import view

    return view(args.host, args.port, args.allow, headless=args.headless)
