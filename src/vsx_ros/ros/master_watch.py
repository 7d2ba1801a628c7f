"""Whether the ROS master still answers. Without it nobody can be found, stopped or replaced."""

from __future__ import annotations

import http.client
import math
import threading
import time
import xmlrpc.client

import rosgraph
import rospy

PERIOD_S = 0.1
ANSWER_S = 0.35
SILENT_AFTER_S = 0.4


class _Impatient(xmlrpc.client.Transport):
    """A hanging master accepts connections and never answers."""

    def make_connection(self, host: object) -> http.client.HTTPConnection:
        connection = super().make_connection(host)  # type: ignore[arg-type]  # typeshed's host is private
        connection.timeout = ANSWER_S
        return connection


class MasterWatch:
    """Asks ten times a second on a thread of its own."""

    def __init__(self) -> None:
        self._master = xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=_Impatient())
        self._answered_s = time.monotonic()
        threading.Thread(target=self._ask, name="master", daemon=True).start()

    @property
    def answers(self) -> bool:
        """Whether it answered lately."""
        return time.monotonic() - self._answered_s < SILENT_AFTER_S

    def _ask(self) -> None:
        while not rospy.is_shutdown():
            try:
                self._master.getPid(rospy.get_name())
                self._answered_s = time.monotonic()
                self._master("close")()  # a master that is ending answers who is connected, and nobody else
            except ConnectionRefusedError:
                self._answered_s = -math.inf  # a master that is there and slow refuses nobody
            except Exception:  # no answer, or what nobody can understand
                pass
            time.sleep(PERIOD_S)
