"""Rooms on topics: found in the ground map every few seconds, named by the user."""

import json
import threading
import time
from pathlib import Path

import rospy
from std_msgs.msg import String

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.io.room_file import load_rooms, room_file, room_tree, save_rooms
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import RoomMap, RoomTracker
from vsx_ros.ros import topics
from vsx_ros.ros.callbacks import json_object, offer_text
from vsx_ros.runs.rooms import renamed


class RoomServer:
    """Publishers: rooms (latched). Services: rooms/name (AddDiagnostics: JSON {"room": name or number, "name": new
    name})."""

    def __init__(self, config: Config, before: Path | None = None) -> None:
        """before: the file of the map that is continued; its rooms keep their numbers and names. Raises MapFileError
        for damaged rooms beside it."""
        self._every_s, self._tracker = config.rooms.every_s, RoomTracker(config.rooms)
        if before is not None and (saved := load_rooms(room_file(before))) is not None:
            self._tracker.resume(saved)
        self._lock = threading.Lock()
        self._grid: OccupancyGrid | None = None
        self._due_s, self._told = 0.0, ""
        self._rooms_pub = rospy.Publisher(topics.ROOMS, String, queue_size=1, latch=True)
        offer_text(topics.NAME_ROOM, self._name)

    def update(self, grid: OccupancyGrid) -> None:
        """Split a new ground map, if the last one was a while ago."""
        if grid is not self._grid and time.monotonic() >= self._due_s:
            self._grid, self._due_s = grid, time.monotonic() + self._every_s
            with self._lock:
                self._publish(self._tracker.update(grid))

    def write(self, map_file: Path) -> None:
        """Write the rooms beside a map. Raises MapFileError."""
        with self._lock:
            if self._tracker.current is not None:
                save_rooms(self._tracker.current, room_file(map_file))

    def _publish(self, rooms: RoomMap) -> None:
        text = json.dumps(room_tree(rooms))
        if text != self._told:
            self._told = text
            self._rooms_pub.publish(text)

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
        return f"room {tree['room']} is called {tree['name']!r}"
