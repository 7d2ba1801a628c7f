"""Node ``dashboard``: the live view in a browser.

Subscribers, while somebody looks: vslam/{preview/compressed,pose,state,keyframes,stats/*}, map, explore/{status,
    events,frontiers}, move_base/{global_plan,stats/plan_ms}, mobile_base/hazards, cmd_vel_mux/active, /diagnostics.
Services called: explore/{pause,resume,home,stop}, mobile_base/estop.
Parameters: ~host (127.0.0.1: this machine alone), ~port (8765), ~allow (names beside those of this machine under which
    the view is opened, NAME or NAME:PORT, by commas).
Environment: VSX_VIEW_TOKEN, which commands must show; without it one is made and printed once."""

import os
import secrets
import sys
import time
import webbrowser
from typing import Any

import rosgraph
import rospy
from std_srvs.srv import SetBool, Trigger

from vsx_ros.config import Config
from vsx_ros.ros import calls, logs, node, threads, topics
from vsx_ros.ros.dashboard.feed import Board, Feed, text
from vsx_ros.ros.dashboard.server import DEFAULT_PORT, LOOPBACK, Answer, Command, ViewServer, address, choose_port
from vsx_ros.ros.host_address import DEFAULT_MASTER, export_ros_address
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs.process import DONE

TOKEN = "VSX_VIEW_TOKEN"

_MASTER_PERIOD_S, _LOOK_PERIOD_S = 2.0, 0.5  # a person waits for the page
_SERVICE_WAIT_S = 2.0  # then the button says that nobody answers


class DashboardNode:
    """Serves the page; outlives the stack it shows. allow: names by commas."""

    def __init__(self, host: str, port: int, allow: str) -> None:
        allowed = [name.strip() for name in allow.split(",") if name.strip()]
        board = Board()
        token = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
        self._server = ViewServer(board, commands(), Feed(board).viewers, token, host, port, allowed)
        if TOKEN not in os.environ:
            os.environ[TOKEN] = token
            sys.stderr.write(f"live view: {address(host, self._server.server_port, token)}\n")
        threads.worker("http", self._server.serve_forever)
        threads.every(_MASTER_PERIOD_S, "master", lambda: board.post("stack", text(master_watch().answers)))

    def close(self) -> None:
        """No more requests."""
        self._server.close()


def commands() -> dict[str, Command]:
    """What the page may ask for: the services behind its buttons."""
    return {
        "pause": _call(topics.EXPLORE_PAUSE, Trigger),
        "resume": _call(topics.EXPLORE_RESUME, Trigger),
        "home": _call(topics.EXPLORE_HOME, Trigger),
        "stop": _call(topics.EXPLORE_STOP, Trigger),
        "estop": _call(topics.ESTOP, SetBool, True),
        "release": _call(topics.ESTOP, SetBool, False),
    }


def _call(service: str, kind: type[Any], *arguments: object) -> Command:
    def call() -> Answer:
        try:
            response = calls.service(service, kind, *arguments, within_s=_SERVICE_WAIT_S)
        except (rospy.ROSException, rospy.ServiceException):
            return Answer(False, f"service {rospy.resolve_name(service)} does not answer; is its node running?")
        return Answer(bool(response.success), str(response.message))

    return call


def main() -> None:
    """Entry point of scripts/dashboard."""

    def from_parameters(_: Config) -> DashboardNode:
        host, port = str(rospy.get_param("~host", LOOPBACK)), int(rospy.get_param("~port", DEFAULT_PORT))
        return DashboardNode(host, port, str(rospy.get_param("~allow", "")))

    node.run("dashboard", from_parameters)


def prepare_view(host: str = LOOPBACK, port: int | None = None) -> tuple[int, str]:
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
    """``vsx view``: wait for a master, then be the node. Raises ConfigError when the address cannot be listened on."""
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
