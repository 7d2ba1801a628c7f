"""Rooms on topics: found in the ground map every few seconds, named by the user."""

import json
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import rospy
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import MarkerArray

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.room_file import load_rooms, room_file, room_of, room_tree, save_rooms
from vsx_ros.limits import DAMAGE
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import Room, RoomMap, RoomTracker
from vsx_ros.ros import headers, topics
from vsx_ros.ros.callbacks import json_object, offer_text
from vsx_ros.ros.outlines import Outline, outline_markers
from vsx_ros.runs.rooms import renamed

_COLOR = ColorRGBA(0.55, 0.75, 0.95, 1.0)


class RoomServer:
    """Publishers: rooms (latched; "here" is the number of the room that the robot is in, or null), rooms/markers
    (latched). Services: rooms/name (AddDiagnostics: JSON {"room": name or number, "name": new name})."""

    def __init__(self, config: Config, before: Path | None = None, kept: Path | None = None) -> None:
        """before: the file of the map that is continued; its rooms keep their numbers and names. kept: the file beside
        which names are written at once, so that they survive a kill. Raises MapFileError for damaged rooms."""
        self._kept = kept
        self._every_s, self._tracker = config.rooms.every_s, RoomTracker(config.rooms)
        if before is not None and (saved := load_rooms(room_file(before))) is not None:
            self._tracker.resume(saved)
        self._lock = threading.Lock()
        self._grid: OccupancyGrid | None = None
        self._due_s, self._told = 0.0, ""
        self._here: int | None = None
        self._rooms_pub = rospy.Publisher(topics.ROOMS, String, queue_size=1, latch=True)
        self._markers_pub = rospy.Publisher(topics.ROOM_MARKERS, MarkerArray, queue_size=1, latch=True)
        offer_text(topics.NAME_ROOM, self._name)

    def update(self, grid: OccupancyGrid, T_map_base: SE2 | None) -> None:
        """Split a new ground map, if the last one was a while ago. T_map_base: None if unknown."""
        with self._lock:
            if grid is not self._grid and time.monotonic() >= self._due_s:
                self._grid, self._due_s = grid, time.monotonic() + self._every_s
                self._tracker.update(grid)
            rooms = self._tracker.current
            if rooms is not None:
                room = rooms.at(T_map_base.x, T_map_base.y) if T_map_base is not None else None
                self._here = room.number if room is not None else None
                self._publish(rooms)

    def write(self, map_file: Path) -> None:
        """Write the rooms beside a map. Raises MapFileError."""
        with self._lock:
            if self._tracker.current is not None:
                save_rooms(self._tracker.current, room_file(map_file))

    def _publish(self, rooms: RoomMap) -> None:
        text = json.dumps({**room_tree(rooms), "here": self._here})
        if text != self._told:
            self._told = text
            self._rooms_pub.publish(text)
            self._markers_pub.publish(room_markers(rooms.rooms, headers.now_ns()))

    def _name(self, text: str) -> str:
        tree = json_object(String(text), "room", "name")
        with self._lock:
            rooms = self._tracker.current
            if rooms is None:
                raise InputError("there is no ground map yet, so no room")
            for room in renamed(rooms, str(tree["room"]), str(tree["name"])).rooms:
                if room.name == tree["name"]:
                    self._tracker.rename(room.number, room.name)
            assert self._tracker.current is not None
            self._publish(self._tracker.current)
            if self._kept is not None:
                save_rooms(self._tracker.current, room_file(self._kept))
        return f"room {tree['room']} is called {tree['name']!r}"


def heard_rooms(msg: String) -> tuple[list[Room], int | None]:
    """The rooms, and the number of the one that the robot is in. Raises InputError for a message that no ``RoomServer``
    has published."""
    tree = json_object(msg, "rooms")
    try:
        here = tree.get("here")
        return [room_of(entry) for entry in tree["rooms"]], None if here is None else int(here)
    except DAMAGE as error:
        raise InputError(f"{msg.data[:80]!r} lists no rooms: {error}") from error


def room_markers(rooms: Sequence[Room], stamp_ns: int) -> MarkerArray:
    """The outline and the name of each room."""
    outlines = [
        Outline(name=room.name, points=room.outline, closed=True, color=_COLOR, place=room.place) for room in rooms
    ]
    return outline_markers("rooms", outlines, stamp_ns)
