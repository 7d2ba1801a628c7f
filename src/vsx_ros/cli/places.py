"""``vsx zone`` and ``vsx room``: where a robot may go and what its rooms are called, on the running robot or beside a
saved map."""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vsx_ros.errors import ConfigError, InputError, VsxError
from vsx_ros.io.room_file import load_rooms, room_file, room_tree, save_rooms
from vsx_ros.io.zone_file import zone_file
from vsx_ros.occupancy.zones import Zone, ZoneKind, zone_of
from vsx_ros.runs.places import draw_zones, zones_beside
from vsx_ros.runs.process import DONE
from vsx_ros.runs.rooms import renamed

_IN_QUOTES = "write 'x,y x,y x,y' in metres, in quotes"
_MAP_FILES = ".vsxmap", ".yaml", ".yml", ".pgm", ".png"


def zone(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    run = {"add": _add, "list": _list_zones, "remove": _remove}
    return run[args.verb](args)


def _add(args: argparse.Namespace) -> int:
    if args.kind == ZoneKind.SLOW.value and args.speed is None:
        raise ConfigError(f"zone {args.name!r}: a slow zone needs its speed: add --speed 0.1")
    tree: dict[str, Any] = {"name": args.name, "kind": args.kind, "points": _corners(" ".join(args.points))}
    if args.speed is not None:
        tree["v_m_s"] = args.speed
    drawn = zone_of(tree)
    if args.map is None:
        return _on_robot("change_zones", {"add": drawn.tree()})

    def change(zones: list[Zone]) -> list[Zone]:
        return [other for other in zones if other.name != drawn.name] + [drawn]

    return _in_file(args.map, change, f"zone {drawn.name!r} is drawn: {drawn.kind.value}, {len(drawn.points)} corners")


def _remove(args: argparse.Namespace) -> int:
    if args.map is None:
        return _on_robot("change_zones", {"remove": args.name})

    def change(zones: list[Zone]) -> list[Zone]:
        if args.name not in [zone.name for zone in zones]:
            there = ", ".join(repr(zone.name) for zone in zones) or "none"
            raise InputError(f"there is no zone {args.name!r:.60} beside {args.map}; the zones are: {there}")
        return [zone for zone in zones if zone.name != args.name]

    return _in_file(args.map, change, f"zone {args.name!r} is removed")


def _list_zones(args: argparse.Namespace) -> int:
    if args.map is None:
        tree = _heard("zones")
        zones = [zone_of(entry) for entry in tree["zones"]]
    else:
        zones = zones_beside(_existing(args.map))
    if args.json:
        print(json.dumps([zone.tree() for zone in zones]))
        return DONE
    for zone in zones:
        print(f"{zone.words()}: {' '.join(f'{x:.2f},{y:.2f}' for x, y in zone.points)}")
    if not zones:
        print("no zones: the robot may go everywhere")
    return DONE


def _corners(text: str) -> list[list[float]]:
    """Raises ConfigError for anything but pairs "x,y" with spaces between."""
    try:
        corners = [[float(number) for number in pair.split(",")] for pair in text.split()]
    except ValueError as error:
        raise ConfigError(f"corners {text!r:.60}: {error}; {_IN_QUOTES}") from error
    if not all(len(corner) == 2 and math.isfinite(sum(corner)) for corner in corners):
        raise ConfigError(f"corners {text!r:.60}: each is a pair of numbers; {_IN_QUOTES}")
    return corners


def _in_file(map_file: Path, change: Callable[[list[Zone]], list[Zone]], said: str) -> int:
    map_file = _existing(map_file)
    draw_zones(change(zones_beside(map_file)), map_file)
    print(f"{said} ({zone_file(map_file)})")
    return DONE


def _existing(map_file: Path) -> Path:
    """The file. Raises ConfigError if it is no map: beside a misspelt one, nothing would read the zones."""
    if not map_file.is_file():
        raise ConfigError(f"there is no map {map_file}; 'vsx map save' makes one, and each run has a map.yaml")
    if map_file.suffix not in _MAP_FILES:
        raise ConfigError(f"{map_file} is no map; give a .vsxmap, a map.yaml or a run folder")
    return map_file


def room(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    return {"list": _list_rooms, "name": _name}[args.verb](args)


def _list_rooms(args: argparse.Namespace) -> int:
    if args.map is None:
        tree = _heard("rooms")
    else:
        rooms = load_rooms(room_file(_existing(args.map)))
        if rooms is None:
            raise ConfigError(f"beside {args.map} are no rooms; a run writes them with its map")
        tree = room_tree(rooms)
    if args.json:
        print(json.dumps(tree["rooms"]))
        return DONE
    for entry in tree["rooms"]:
        x, y = entry["place"]
        known = 100.0 * entry["known_ratio"]
        told = f"{entry['number']:3} {entry['name']:24} {entry['area_m2']:6.1f} m2  {known:3.0f} % known"
        print(f"{told}  ({x:.1f}, {y:.1f})")
    if not tree["rooms"]:
        print("no rooms yet: they are found while the map grows")
    return DONE


def _name(args: argparse.Namespace) -> int:
    if args.map is None:
        return _on_robot("name_room", {"room": args.room, "name": args.name})
    path = room_file(_existing(args.map))
    rooms = load_rooms(path)
    if rooms is None:
        raise ConfigError(f"beside {args.map} are no rooms; a run writes them with its map")
    save_rooms(renamed(rooms, args.room, args.name), path)
    print(f"room {args.room} is called {args.name!r} ({path})")
    return DONE


def _on_robot(what: str, tree: dict[str, Any]) -> int:
    from vsx_ros.ros import operator_places

    code: int = getattr(operator_places, what)(json.dumps(tree))
    return code


def _heard(what: str) -> dict[str, Any]:
    from vsx_ros.ros.operator_places import heard

    tree: dict[str, Any] = heard(what)
    if what not in tree:
        raise VsxError(f"topic {what} says something else than {what}; is another program publishing it?")
    return tree
