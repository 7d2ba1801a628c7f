"""The live view behind ``vsx view`` and ``vsx explore --view``: an address, a token, and the node that serves it."""

import os
import secrets
import sys
import time
import webbrowser

import rosgraph

from vsx_ros.ros import logs, node
from vsx_ros.ros.dashboard.server import LOOPBACK, address, choose_port
from vsx_ros.ros.host_address import DEFAULT_MASTER, export_ros_address
from vsx_ros.ros.nodes.dashboard import TOKEN, DashboardNode
from vsx_ros.runs.exit_codes import DONE

_MASTER_PERIOD_S = 0.5


def prepare(host: str = LOOPBACK, port: int | None = None) -> tuple[int, str]:
    """A port that is free and the address to open; the token goes to the environment, for the node to inherit. Raises
    ConfigError when the address cannot be listened on."""
    port = choose_port(host, port)
    token = os.environ[TOKEN] = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
    return port, address(host, port, token)


def open_browser(url: str) -> None:
    """Show the page, where there is a screen to show it on."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


def view(host: str, port: int | None, allow: str, *, headless: bool) -> int:
    """Wait for a master, then be the node. Raises ConfigError when the address cannot be listened on."""
    export_ros_address()
    logs.quiet_failures()
    port, url = prepare(host, port)
    sys.stderr.write(f"live view: {url}\n")
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        sys.stderr.write(f"waiting for a ROS master at {uri}; 'vsx explore' or roslaunch bring one; Ctrl-C ends\n")
    try:
        while not rosgraph.is_master_online():
            time.sleep(_MASTER_PERIOD_S)
    except KeyboardInterrupt:
        return DONE
    if not headless:
        open_browser(url)
    node.run(f"view_{os.getpid()}", lambda _: DashboardNode(host, port, allow))
    return DONE
