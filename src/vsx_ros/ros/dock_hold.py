"""While the node dock moves the base, or has it on the dock, nobody else moves it."""

import math
import time

from std_msgs.msg import String

from vsx_ros.ros import topics
from vsx_ros.ros.callbacks import json_object, subscribe

_GONE_S = 3.0  # a node that says nothing for so long has ended: it repeats its status each second


class DockHold:
    """Subscribers: dock/status."""

    def __init__(self) -> None:
        self._words, self._heard_s = "", -math.inf
        subscribe(topics.DOCK_STATUS, String, self._on_status, queue_size=5, tcp_nodelay=True)

    def _on_status(self, msg: String) -> None:
        told = json_object(msg, "holds", "reason")
        why = told["reason"] or "the base stands on it"
        self._words = f"the dock has the wheels: {why}" if told["holds"] is True else ""
        self._heard_s = time.monotonic()

    @property
    def words(self) -> str:
        """Why the dock holds the wheels; empty if it does not."""
        return self._words if time.monotonic() - self._heard_s < _GONE_S else ""
