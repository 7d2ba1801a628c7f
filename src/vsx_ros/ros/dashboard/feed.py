"""From topics to the board, only while somebody looks: without a viewer nothing is subscribed."""

import base64
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from genpy.message import get_message_class
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Float32, String, UInt8, UInt32
from visualization_msgs.msg import MarkerArray

from vsx_ros.ros import threads, topics
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.ros.convert import hazard_words
from vsx_ros.ros.dashboard import json_messages
from vsx_ros.ros.dashboard.board import Board

_GRACE_S = 3.0
"""A page that is loaded again comes back within this time and finds everything still there."""

_EVENTS = 60
_SHOWN_STATS = ("tracked", "attempted", "keyframes", "points", "latency_ms")
"""The others follow from these, or stand in the diagnostics, once a second instead of with every image."""


class Feed:
    """``viewers`` says how many look; subscriptions follow a moment later, on a thread of their own."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._viewers = 0
        self._changed = threading.Event()
        self._lock = threading.Lock()
        self._subscribers: list[rospy.Subscriber] = []
        self._forget()
        threads.worker("feed", self._follow)

    def viewers(self, count: int) -> None:
        """Somebody came or went."""
        self._viewers = count
        self._changed.set()

    def _follow(self) -> None:
        while not rospy.is_shutdown():
            if not self._changed.wait(timeout=1.0):
                continue
            self._changed.clear()
            if self._viewers and not self._subscribers:
                self._subscribe()
            elif self._subscribers and not self._viewers and not self._changed.wait(timeout=_GRACE_S):
                for subscriber in self._subscribers:
                    subscriber.unregister()
                self._forget()

    def _forget(self) -> None:
        self._subscribers = []
        self._stats: dict[str, float] = {}
        self._health: dict[str, list[Any]] = {}
        self._events: deque[Any] = deque(maxlen=_EVENTS)
        self._board.clear()

    def _subscribe(self) -> None:
        def hear(topic: str, kind: type[Any], subject: str, convert: Callable[[Any], Any], **options: Any) -> None:
            def on_message(msg: Any) -> None:
                self._board.post(subject, json_messages.text(convert(msg)))

            self._subscribers.append(subscribe(topic, kind, on_message, **{"queue_size": 1, **options}))

        hear(
            topics.PREVIEW, CompressedImage, "camera", lambda msg: base64.b64encode(msg.data).decode(), buff_size=2**20
        )
        hear(topics.POSE, PoseWithCovarianceStamped, "pose", json_messages.pose)
        hear(topics.SLAM_STATE, DiagnosticStatus, "slam", lambda msg: [msg.name, msg.message])
        hear(topics.EXPLORE_STATUS, String, "mission", json_messages.parsed)
        hear(topics.EXPLORE_EVENTS, String, "events", self._event, queue_size=20)
        hear(topics.MAP, OccupancyGridMsg, "map", json_messages.grid)
        hear(topics.FRONTIERS, MarkerArray, "frontiers", json_messages.frontiers)
        hear(topics.KEYFRAMES, PoseArray, "keyframes", json_messages.keyframes)
        hear(topics.GLOBAL_PLAN, PathMsg, "plan", json_messages.plan)
        hear(topics.HAZARDS, UInt8, "hazards", lambda msg: hazard_words(msg.data))
        hear(topics.MUX_ACTIVE, String, "driver", lambda msg: msg.data)
        hear(topics.DIAGNOSTICS, DiagnosticArray, "health", self._condition, queue_size=20)
        hear(topics.PLAN_MS, Float32, "stats", self._statistic("plan_ms"))
        for name in _SHOWN_STATS:
            hear(f"{topics.STATS}/{name}", get_message_class(topics.STAT_TYPES[name]), "stats", self._statistic(name))

    def _statistic(self, name: str) -> Callable[[Float32 | UInt32], dict[str, float]]:
        def convert(msg: Float32 | UInt32) -> dict[str, float]:
            with self._lock:
                self._stats[name] = msg.data
                return dict(self._stats)

        return convert

    def _event(self, msg: String) -> list[Any]:
        with self._lock:
            self._events.append(json_messages.parsed(msg))
            return list(self._events)

    def _condition(self, msg: DiagnosticArray) -> dict[str, list[Any]]:
        with self._lock:
            for status in msg.status:
                if not f"/{status.name}".startswith(rospy.get_namespace()):
                    continue  # another robot's
                values = {pair.key: pair.value for pair in status.values}
                self._health[status.name] = [int(status.level), status.message, values]
            return dict(self._health)
