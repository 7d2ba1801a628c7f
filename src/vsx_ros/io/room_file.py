"""Rooms beside a map: ``lab_rooms.json`` lists them, ``lab_rooms.pgm`` is a picture whose grey value is the room's
number, of the size and place of the map's own picture."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vsx_ros.errors import MapFileError, explained, reason_of
from vsx_ros.io.atomic import write_together
from vsx_ros.io.image_file import picture
from vsx_ros.limits import DAMAGE, TEXT_BYTES, file_bytes, file_text, json_tree
from vsx_ros.occupancy.grid import MAX_CELLS, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.rooms import MOST_ROOMS, Room, RoomMap

_VERSION = 1


def room_file(map_file: Path) -> Path:
    """Where the rooms of a map are; the picture has the same name, .pgm."""
    return map_file.with_name(f"{map_file.stem}_rooms.json")


def room_tree(rooms: RoomMap) -> dict[str, Any]:
    """The rooms as a tree for JSON."""
    grid = rooms.grid
    place = {"resolution": round(grid.resolution, 6), "origin": [grid.origin_x, grid.origin_y]}
    found, absent = ([room._asdict() for room in some] for some in (rooms.rooms, rooms.absent))
    return {"version": _VERSION, **place, "rooms": found, "absent": absent}


def save_rooms(rooms: RoomMap | None, path: Path) -> None:
    """Write both files. Without rooms, earlier ones are removed. Raises MapFileError when they cannot be written, or
    for more than 255 rooms."""
    if rooms is None:
        with explained(MapFileError, f"rooms {path} cannot be removed", "choose another folder", OSError):
            path.unlink(missing_ok=True)
            path.with_suffix(".pgm").unlink(missing_ok=True)
        return
    if any(room.number > MOST_ROOMS for room in rooms.rooms):
        raise MapFileError(f"rooms {path}: a picture has {MOST_ROOMS} grey values, too few for these; start a new map")
    rows, columns = rooms.labels.shape
    grey = rooms.labels.astype(np.uint8)
    with explained(MapFileError, f"rooms {path} cannot be written", "choose another folder", OSError):
        picture_of = f"P5\n{columns} {rows}\n255\n".encode() + grey[::-1].tobytes()
        text = json.dumps(room_tree(rooms), indent=1, ensure_ascii=False) + "\n"
        write_together({path.with_suffix(".pgm"): picture_of, path: text.encode()}, durable=True)


def load_rooms(path: Path) -> RoomMap | None:
    """The rooms of a file, on a map of which nothing else is known; None if it does not exist. Raises MapFileError."""
    if not path.exists():
        return None
    try:
        tree = json_tree(file_text(path))
        if tree["version"] != _VERSION:
            raise ValueError(f"it has version {tree['version']}, this program reads {_VERSION}")
        rooms = tuple(room_of(entry) for entry in tree["rooms"][: MOST_ROOMS + 1])
        absent = tuple(room_of(entry) for entry in tree.get("absent", [])[:MOST_ROOMS])  # older versions wrote none
        image = picture(file_bytes(path.with_suffix(".pgm"), MAX_CELLS + TEXT_BYTES), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError("its picture is none")
        labels = image[::-1].astype(np.int64)
        x, y = (float(value) for value in tree["origin"])
        grid = OccupancyGrid(np.full(labels.shape, UNKNOWN, np.int8), float(tree["resolution"]), x, y)
    except DAMAGE as error:
        reason = f"entry {error} is missing" if isinstance(error, KeyError) else reason_of(error)
        raise MapFileError(f"rooms {path} cannot be used: {reason}; remove it, and the rooms are found anew") from error
    return RoomMap(grid, labels, rooms, absent)


def room_of(entry: Any) -> Room:
    """A room of ``room_tree``. Raises one of ``limits.DAMAGE`` for anything else."""
    outline = tuple((float(x), float(y)) for x, y in entry["outline"][:1000])
    x, y = (float(value) for value in entry["place"])
    numbers = [float(entry[name]) for name in ("area_m2", "known_ratio")]
    values = [*numbers, x, y, *(value for point in outline for value in point)]
    if not np.isfinite(values).all() or not 0 < int(entry["number"]) <= MOST_ROOMS:
        raise ValueError(f"{str(entry)[:60]} is no room")
    return Room(
        number=int(entry["number"]), name=str(entry["name"])[:100], area_m2=numbers[0], known_ratio=numbers[1],
        place=(x, y), outline=outline,
    )  # fmt: skip
