"""Converts topics to short JSON for the page, and posts it on the board. Subscribes only while there is a viewer."""

import base64
import json
import math
import re
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from genpy.message import get_message_class
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Float32, String, UInt8, UInt32
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.errors import InputError
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN
from vsx_ros.ros import convert, headers, threads, topics
from vsx_ros.ros.callbacks import json_object, subscribe
from vsx_ros.ros.dashboard.conditions import Conditions

_GRACE_S = 3.0  # A reloaded page comes back within this time and finds all data still there

_EVENTS = 60  # the newest ones, for a page that is opened late
_SHOWN_STATS = ("tracked", "attempted", "keyframes", "points", "latency_ms")
"""The others follow from these, or are in the diagnostics, once a second instead of with every image."""
_FREE_BGRA, _OCCUPIED_BGRA = (92, 70, 52, 255), (236, 232, 228, 255)  # of the map in the browser
_UTILITY = re.compile(r"\bU ([0-9.]+)")
_PLAN_POINTS, _WAY_POINTS = 200, 2000  # more would not be visible on a screen
_GAP_M = 0.5  # between poses of the way; the robot leaves one every few centimetres


class Note(NamedTuple):
    """The newest text of one subject. number: counts all posted texts. text: JSON, one line."""

    number: int
    subject: str
    text: str


class Board:
    """A new text replaces the old one of its subject, so a slow viewer skips texts but never lags. Thread-safe."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._notes: dict[str, Note] = {}
        self._number = 0

    def post(self, subject: str, text: str) -> None:
        """Replace the text of a subject."""
        with self._news:
            self._number += 1
            self._notes[subject] = Note(self._number, subject, text)
            self._news.notify_all()

    def clear(self) -> None:
        """Remove everything: old data would look new to the next viewer."""
        with self._news:
            self._notes.clear()

    def newer_than(self, number: int, timeout_s: float) -> list[Note]:
        """Notes after the one with that number, oldest first; empty if none comes within the time."""
        with self._news:
            self._news.wait_for(lambda: self._number > number, timeout_s)
            return sorted(note for note in self._notes.values() if note.number > number)


class Feed:
    """``viewers`` sets the number of viewers; subscriptions follow a moment later, on a separate thread."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._viewers = 0
        self._changed = threading.Event()
        self._lock = threading.Lock()
        self._subscribers: list[rospy.Subscriber] = []
        self._forget()
        threads.worker("feed", self._follow)

    def viewers(self, count: int) -> None:
        """The number of viewers changed."""
        self._viewers = count
        self._changed.set()

    def tell_silent(self) -> None:
        """Post who has become silent, and who speaks again; called once a second."""
        if (silent := self._conditions.changed()) is not None:
            self._board.post("health", text(self._conditions.health()))
            self._board.post("silent", text(silent))

    def _follow(self) -> None:
        while not rospy.is_shutdown():
            if not self._changed.wait(timeout=1.0):
                self.tell_silent()
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
        self._conditions = Conditions()
        self._events: deque[Any] = deque(maxlen=_EVENTS)
        self._board.clear()

    def _subscribe(self) -> None:
        def hear(topic: str, kind: type[Any], subject: str, shown: Callable[[Any], Any], **options: Any) -> None:
            def on_message(msg: Any) -> None:
                self._conditions.heard(subject)
                self._board.post(subject, text(shown(msg)))

            self._subscribers.append(subscribe(topic, kind, on_message, **{"queue_size": 1, **options}))

        self._board.post("silent", "[]")
        hear(
            topics.PREVIEW, CompressedImage, "camera", lambda msg: base64.b64encode(msg.data).decode(), buff_size=2**20
        )
        hear(topics.POSE, PoseWithCovarianceStamped, "pose", pose)
        hear(topics.SLAM_STATE, DiagnosticStatus, "slam", lambda msg: [msg.name, msg.message])
        hear(topics.EXPLORE_STATUS, String, "mission", json_object)
        hear(topics.EXPLORE_EVENTS, String, "events", self._event, queue_size=20)
        hear(topics.MAP, OccupancyGridMsg, "map", grid)
        hear(topics.ZONES, String, "zones", json_object)
        hear(topics.ROOMS, String, "rooms", json_object)
        hear(topics.FRONTIERS, MarkerArray, "frontiers", frontiers)
        hear(topics.PLANES, MarkerArray, "planes", planes)
        hear(topics.KEYFRAMES, PoseArray, "keyframes", keyframes)
        hear(topics.GLOBAL_PLAN, PathMsg, "plan", plan)
        hear(topics.SLAM_PATH, PathMsg, "way", way)
        hear(topics.HAZARDS, UInt8, "hazards", lambda msg: convert.hazard_words(msg.data))
        hear(topics.OPERATOR_HOLD, String, "held", json_object)
        hear(topics.DOCK_STATUS, String, "dock", json_object)
        hear(topics.MUX_ACTIVE, String, "driver", lambda msg: msg.data)
        hear(topics.DIAGNOSTICS, DiagnosticArray, "health", self._conditions.take, queue_size=20)
        hear(topics.PLAN_MS, Float32, "stats", self._statistic("plan_ms"))
        for name in _SHOWN_STATS:
            hear(f"{topics.STATS}/{name}", get_message_class(topics.STAT_TYPES[name]), "stats", self._statistic(name))

    def _statistic(self, name: str) -> Callable[[Float32 | UInt32], dict[str, float]]:
        def shown(msg: Float32 | UInt32) -> dict[str, float]:
            with self._lock:
                self._stats[name] = msg.data
                return dict(self._stats)

        return shown

    def _event(self, msg: String) -> list[Any]:
        with self._lock:
            self._events.append(json_object(msg))
            return list(self._events)


def text(value: Any) -> str:
    """One line of JSON. Raises InputError for a number that is not finite."""
    try:
        return json.dumps(value, allow_nan=False, separators=(",", ":"))
    except ValueError as error:
        raise InputError(f"message with a number that is not finite: {error}") from error


def pose(msg: PoseWithCovarianceStamped) -> list[float]:
    """x, y [m], heading [rad]."""
    found = convert.se2(msg.pose.pose)
    return [round(found.x, 3), round(found.y, 3), round(found.theta, 3)]


def grid(msg: OccupancyGridMsg) -> dict[str, Any]:
    """A PNG of the known cells, top row first, unknown transparent; resolution and lower left corner [m], area [m2]."""
    found = convert.grid(msg)
    rows, columns = (np.flatnonzero((found.data != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    bottom, left = (int(rows[0]), int(columns[0])) if rows.size else (0, 0)
    cells = found.data[bottom : rows[-1] + 1, left : columns[-1] + 1] if rows.size else found.data[:1, :1]
    picture = np.zeros((*cells.shape, 4), np.uint8)
    picture[cells == FREE] = _FREE_BGRA
    picture[cells == OCCUPIED] = _OCCUPIED_BGRA
    _, png = cv2.imencode(".png", np.ascontiguousarray(picture[::-1]), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return {
        "png": base64.b64encode(png.tobytes()).decode(),
        "resolution": found.resolution,
        "x": found.origin_x + left * found.resolution,
        "y": found.origin_y + bottom * found.resolution,
        "known_m2": found.known_area_m2,
    }


def frontiers(msg: MarkerArray) -> dict[str, Any]:
    """borders: x, y [m] of each frontier's cells. views: x, y, U and text of each ranked view, best first."""
    borders, views = [], []
    for marker in msg.markers:
        if marker.action == Marker.ADD and marker.type == Marker.POINTS:
            borders.append([[round(p.x, 2), round(p.y, 2)] for p in marker.points])
        elif marker.action == Marker.ADD and marker.type == Marker.TEXT_VIEW_FACING:
            where, found = marker.pose.position, _UTILITY.search(marker.text)
            utility = float(found.group(1)) if found else None
            views.append({"x": where.x, "y": where.y, "utility": utility, "text": marker.text})
    return {"borders": borders, "views": views}


def planes(msg: MarkerArray) -> list[list[list[float]]]:
    """Corners x, y [m] of each plane, seen from above: of a wall a line, there and back."""
    found = [m.points for m in msg.markers if m.action == Marker.ADD and m.type == Marker.TRIANGLE_LIST]
    return [[[round(p.x, 2), round(p.y, 2)] for p in (*points[:3], *points[-1:])] for points in found]


def keyframes(msg: PoseArray) -> list[list[float]]:
    """x, y [m] of each camera and its viewing direction on the floor [rad]."""
    found = []
    for T in map(convert.se3, msg.poses):
        (x, y, _), (east, north, _) = T.translation.tolist(), T.rotation[:, 2].tolist()
        found.append([round(x, 2), round(y, 2), round(math.atan2(north, east), 2)])
    return found


def plan(msg: PathMsg) -> list[list[float]]:
    """x, y [m] of the path, thinned; empty if it is not in the map's frame (driven by odometry alone)."""
    if headers.bare(msg.header.frame_id) != topics.MAP_FRAME:
        return []
    step = max(1, len(msg.poses) // _PLAN_POINTS)
    kept = [*msg.poses[::step], *msg.poses[-1:]]
    return [[round(p.pose.position.x, 3), round(p.pose.position.y, 3)] for p in kept]


def way(msg: PathMsg) -> list[list[float] | None]:
    """x, y [m] of where the robot has been, thinned; None where the way between two of them is not known."""
    if not msg.poses:
        return []
    places = np.array([[p.pose.position.x, p.pose.position.y] for p in msg.poses]).round(2)
    broken = np.append(np.hypot(*np.diff(places, axis=0).T) > _GAP_M, True)  # after each place
    begins = np.append(True, broken[:-1])
    kept = np.flatnonzero((np.arange(len(places)) % (1 + len(places) // _WAY_POINTS) == 0) | broken | begins)
    told: list[list[float] | None] = []
    for k in kept.tolist():
        told += [None, places[k].tolist()] if k and begins[k] else [places[k].tolist()]
    return told
