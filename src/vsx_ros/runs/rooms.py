"""The rooms of a run: found in its ground map, named by its user, explored one at a time."""

from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import Room, RoomMap, RoomTracker
from vsx_ros.occupancy.zones import MAX_NAME, Zone, ZoneKind

OF_ONE_RUN = "look into "  # begins the name of the zone for a run that explores one room


def room_beside(map_file: Path, name: str) -> Room:
    """The room of this name, of those beside a map. Raises ConfigError when there is no such room, MapFileError."""
    rooms = load_rooms(room_file(map_file))
    room = rooms.named(name) if rooms is not None else None
    if room is None:
        there = ", ".join(repr(room.name) for room in rooms.rooms) if rooms is not None else "none known yet"
        raise ConfigError(f"there is no room {name!r:.60} beside {map_file} (rooms: {there}); 'vsx room list'")
    return room


def look_into(ground: MappedGround, map_file: Path, name: str) -> None:
    """Explore only the room of this name, of those beside a map. Raises as ``room_beside``."""
    room = room_beside(map_file, name)
    ground.zones.add(Zone(f"{OF_ONE_RUN}{room.name}"[:MAX_NAME], ZoneKind.LOOK, room.outline))


def write_rooms(grid: OccupancyGrid | None, map_file: Path, config: Config, before: Path | None = None) -> None:
    """Find the rooms of a ground map and write them beside the map's file; nothing without a map. before: the file of
    the map that was continued, whose rooms keep their names. Raises MapFileError."""
    if grid is None:
        return
    tracker = RoomTracker(config.rooms)
    if before is not None and (saved := load_rooms(room_file(before))) is not None:
        tracker.resume(saved)
    save_rooms(tracker.update(grid), room_file(map_file))


def renamed(rooms: RoomMap, which: str, name: str) -> RoomMap:
    """The rooms with another name for one of them, given by name or number. Raises InputError for an unknown room, or a
    name that is none or another room's."""
    if not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        raise InputError(f"a room's name is a word or a few, at most {MAX_NAME} characters, not {name!r:.60}")
    numbers = {str(room.number): room for room in rooms.rooms}
    room = rooms.named(which) or numbers.get(which)
    if room is None:
        there = ", ".join(repr(room.name) for room in rooms.rooms) or "none"
        raise InputError(f"there is no room {which!r:.60}; the rooms are: {there}")
    other = rooms.named(name)
    if other is not None and other.number != room.number:
        raise InputError(f"room {other.number} has the name {name!r} already; choose another")
    changed = tuple(r._replace(name=name) if r.number == room.number else r for r in rooms.rooms)
    absent = tuple(r for r in rooms.absent if r.name.casefold() != name.casefold())
    return rooms._replace(rooms=changed, absent=absent)
