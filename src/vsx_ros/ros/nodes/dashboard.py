"""Node ``dashboard``: the live view in a browser.

Subscribers, while there is a viewer: vslam/{preview/compressed,pose,path,state,keyframes,planes,stats/*}, map,
    explore/{status,events,frontiers}, zones, rooms, move_base/{global_plan,stats/plan_ms},
    mobile_base/{hazards,operator_hold}, dock/status, cmd_vel_mux/active, /diagnostics.
Publishers, when somebody drives: move_base/{goal,cancel}, cmd_vel_mux/input/teleop.
Services called: explore/{pause,resume,home,stop}, dock/{start,leave}, mobile_base/estop, move_base/preview_goal,
    zones/change, rooms/name.
Parameters: ~host (127.0.0.1: only this machine), ~port (8765), ~allow (further names under which the view may be
    opened, NAME or NAME:PORT, separated by commas), ~v_m_s (0.2), ~omega_rad_s (0.6): full speeds of the page's stick.
Environment: VSX_VIEW_TOKEN, the token for commands; if it is not set, a token is made and printed once;
VSX_VIEW_PORT, the port to try first, set for the next session of a run."""

import os
import secrets
import sys
import time

import rosgraph
import rospy

from vsx_ros.config import Config
from vsx_ros.ros import logs, node, threads
from vsx_ros.ros.browser import open_browser
from vsx_ros.ros.dashboard.commands import commands
from vsx_ros.ros.dashboard.drives import Drives
from vsx_ros.ros.dashboard.feed import Board, Feed, text
from vsx_ros.ros.dashboard.server import DEFAULT_PORT, LOOPBACK, ViewServer, address, choose_port
from vsx_ros.ros.environment import DEFAULT_MASTER, export_ros_address
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs.process import DONE

TOKEN, PORT = "VSX_VIEW_TOKEN", "VSX_VIEW_PORT"

_MASTER_PERIOD_S, _LOOK_PERIOD_S = 2.0, 0.5  # the second: a person waits for the page


class DashboardNode:
    """Serves the page, also after the stack has ended. allow: names separated by commas. The speeds: full ones of the
    stick."""

    def __init__(self, host: str, port: int, allow: str, v_m_s: float = 0.2, omega_rad_s: float = 0.6) -> None:
        allowed = [name.strip() for name in allow.split(",") if name.strip()]
        board = Board()
        token = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
        served = {**commands(), **Drives(v_m_s, omega_rad_s).commands()}
        self._server = ViewServer(board, served, Feed(board).viewers, token, host, port, allowed)
        if TOKEN not in os.environ:
            os.environ[TOKEN] = token
            sys.stderr.write(f"live view: {address(host, self._server.server_port, token)}\n")
        threads.worker("http", self._server.serve_forever)
        threads.every(_MASTER_PERIOD_S, "master", lambda: board.post("stack", text(master_watch().answers)))

    def close(self) -> None:
        """Stop the server."""
        self._server.close()


def main() -> None:
    """Entry point of scripts/dashboard."""

    def from_parameters(_: Config) -> DashboardNode:
        host, port = str(rospy.get_param("~host", LOOPBACK)), int(rospy.get_param("~port", DEFAULT_PORT))
        speeds = (float(rospy.get_param(name, default)) for name, default in (("~v_m_s", 0.2), ("~omega_rad_s", 0.6)))
        return DashboardNode(host, port, str(rospy.get_param("~allow", "")), *speeds)

    node.run("dashboard", from_parameters)


def prepare_view(host: str = LOOPBACK, port: int | None = None) -> tuple[int, str]:
    """A free port and the address to open. Puts the token into the environment, where the node finds it, and the port,
    so that the next session in this process is at the same address. Raises ConfigError if that cannot be used."""
    before = os.environ.get(PORT, "")
    port = choose_port(host, port, int(before) if before.isdecimal() else DEFAULT_PORT)
    os.environ[PORT] = str(port)
    token = os.environ[TOKEN] = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
    return port, address(host, port, token)


def view(host: str, port: int | None, allow: str, *, headless: bool) -> int:
    """``vsx view``: wait for a master, then run the node. Raises ConfigError if the address cannot be used."""
    export_ros_address()
    logs.quiet_failures()
    port, url = prepare_view(host, port)
    sys.stderr.write(f"live view: {url}\n")
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        sys.stderr.write(f"waiting for a ROS master at {uri}; 'vsx explore' or roslaunch bring one; Ctrl-C ends\n")
    try:
        while not rosgraph.is_master_online():
            time.sleep(_LOOK_PERIOD_S)
    except KeyboardInterrupt:
        return DONE
    if not headless:
        open_browser(url)
    node.run(f"view_{os.getpid()}", lambda _: DashboardNode(host, port, allow))
    return DONE
