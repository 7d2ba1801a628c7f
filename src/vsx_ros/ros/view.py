"""The live view behind ``vsx view`` and ``vsx explore --view``: an address, a token, and the node that serves it."""

from __future__ import annotations

import argparse
import os
import secrets
import sys
import time
import webbrowser

import rosgraph

from vsx_ros.cli.exit_codes import DONE, FAILED
from vsx_ros.cli.view import add_arguments
from vsx_ros.errors import VsxError
from vsx_ros.ros import launch, logs
from vsx_ros.ros.dashboard.server import LOOPBACK, address, choose_port
from vsx_ros.ros.nodes.dashboard import TOKEN

_MASTER_PERIOD_S = 0.5


def prepare(host: str = LOOPBACK, port: int | None = None) -> tuple[int, str]:
    """A port that is free and the address to open; the token goes to the environment, for the node to inherit.

    Raises ConfigError when the address cannot be listened on.
    """
    port = choose_port(host, port)
    token = os.environ[TOKEN] = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
    return port, address(host, port, token)


def open_browser(url: str) -> None:
    """Show the page, where there is a screen to show it on."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


def view(args: argparse.Namespace) -> None:
    """Wait for a master, then become the node. Raises ConfigError when the address cannot be listened on."""
    port, url = prepare(args.host, args.port)
    sys.stderr.write(f"live view: {url}\n")
    uri = os.environ.setdefault("ROS_MASTER_URI", launch.DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        sys.stderr.write(f"waiting for a ROS master at {uri}; 'vsx explore' or roslaunch bring one; Ctrl-C ends\n")
    while not rosgraph.is_master_online():
        time.sleep(_MASTER_PERIOD_S)
    if not args.headless:
        open_browser(url)
    node = ["-m", "vsx_ros.ros.nodes.dashboard", f"__name:=view_{os.getpid()}"]
    os.execv(sys.executable, [sys.executable, *node, f"_host:={args.host}", f"_port:={port}", f"_allow:={args.allow}"])


def main() -> int:
    """Parse and run; errors are one sentence."""
    logs.quiet_failures()
    parser = argparse.ArgumentParser(prog="vsx view")
    add_arguments(parser)
    try:
        view(parser.parse_args())
    except KeyboardInterrupt:
        return DONE
    except VsxError as error:
        sys.stderr.write(f"vsx: {error}\n")
    return FAILED


if __name__ == "__main__":
    sys.exit(main())
