"""Rooms on topics: found in the ground map every few seconds, named by the user."""

import json
import threading
import time
from pathlib import Path

import rospy
from diagnostic_msgs.srv import AddDiagnostics, AddDiagnosticsRequest, AddDiagnosticsResponse
from std_msgs.msg import String

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.io.room_file import load_rooms, room_file, room_tree, save_rooms
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import RoomMap, RoomTracker
from vsx_ros.ros import logs, topics
from vsx_ros.ros.callbacks import json_object
from vsx_ros.runs.rooms import renamed


class RoomServer:
    """Publishers: rooms (latched). Services: rooms/name (AddDiagnostics, because it is a standard type that takes a
    text: JSON {"room": name or number, "name": new name})."""

    def __init__(self, config: Config, before: Path | None = None, kept: Path | None = None) -> None:
        """before: the file of the map that is continued; its rooms keep their numbers and names. kept: the file of this
        run's map; names are written beside it at once. Raises MapFileError for damaged rooms beside ``before``."""
        self._kept = kept
        self._every_s, self._tracker = config.rooms.every_s, RoomTracker(config.rooms)
        if before is not None and (saved := load_rooms(room_file(before))) is not None:
            self._tracker.resume(saved)
        self._lock = threading.Lock()
        self._grid: OccupancyGrid | None = None
        self._due_s, self._told = 0.0, ""
        self._rooms_pub = rospy.Publisher(topics.ROOMS, String, queue_size=1, latch=True)
        rospy.Service(topics.NAME_ROOM, AddDiagnostics, self._on_name)

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

    def _on_name(self, request: AddDiagnosticsRequest) -> AddDiagnosticsResponse:
        try:
            tree = json_object(String(request.load_namespace), "room", "name")
            with self._lock:
                rooms = self._tracker.current
                if rooms is None:
                    return AddDiagnosticsResponse(success=False, message="there is no ground map yet, so no room")
                for room in renamed(rooms, str(tree["room"]), str(tree["name"])).rooms:
                    if room.name == tree["name"]:
                        self._tracker.rename(room.number, room.name)
                assert self._tracker.current is not None
                self._publish(self._tracker.current)
            if (kept := self._kept) is not None:  # a run that is killed is resumed with its names
                logs.attempt(lambda: self.write(kept))
        except VsxError as error:
            return AddDiagnosticsResponse(success=False, message=str(error))
        return AddDiagnosticsResponse(success=True, message=f"room {tree['room']} is called {tree['name']!r}")
