"""Node ``dashboard``: the live view in a browser.

Subscribers, while somebody looks: vslam/{preview/compressed,pose,state,keyframes,stats/*}, map, explore/{status,
    events,frontiers}, move_base/{global_plan,stats/plan_ms}, mobile_base/hazards, cmd_vel_mux/active, /diagnostics.
Services called: explore/{pause,resume,home,stop}, mobile_base/estop.
Parameters: ~host (127.0.0.1: this machine alone), ~port (8765), ~allow (names beside those of this machine under which
    the view is opened, NAME or NAME:PORT, by commas).
Environment: VSX_VIEW_TOKEN, which commands must show; without it one is made and printed once.
"""

import os
import secrets
import sys
import time
from typing import Any

import rospy
from std_srvs.srv import SetBool, Trigger

from vsx_ros.config import Config
from vsx_ros.ros import calls, node, threads, topics
from vsx_ros.ros.dashboard import json_messages
from vsx_ros.ros.dashboard.board import Board
from vsx_ros.ros.dashboard.feed import Feed
from vsx_ros.ros.dashboard.handler import Answer, Command
from vsx_ros.ros.dashboard.server import DEFAULT_PORT, LOOPBACK, ViewServer, address
from vsx_ros.ros.master_watch import master_watch

TOKEN = "VSX_VIEW_TOKEN"

_MASTER_PERIOD_S = 2.0
_SERVICE_WAIT_S = 2.0


class DashboardNode:
    """Serves the page; outlives the stack it shows."""

    def __init__(self, host: str, port: int, allow: str) -> None:
        """allow: names by commas."""
        allowed = [name.strip() for name in allow.split(",") if name.strip()]
        self._board = Board()
        token = os.environ.get(TOKEN) or secrets.token_urlsafe(12)
        feed = Feed(self._board)
        self._server = ViewServer(self._board, commands(), feed.viewers, token, host, port, allowed)
        if TOKEN not in os.environ:
            os.environ[TOKEN] = token
            sys.stderr.write(f"live view: {address(host, self._server.port, token)}\n")
        threads.worker("master", self._watch_master)

    def _watch_master(self) -> None:
        while not rospy.is_shutdown():
            self._board.post("stack", json_messages.text(master_watch().answers))
            time.sleep(_MASTER_PERIOD_S)

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
    node.run("dashboard", _from_parameters)


def _from_parameters(_: Config) -> DashboardNode:
    host, port = str(rospy.get_param("~host", LOOPBACK)), int(rospy.get_param("~port", DEFAULT_PORT))
    return DashboardNode(host, port, str(rospy.get_param("~allow", "")))
