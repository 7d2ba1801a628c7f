"""Maps that leave their run: a SLAM map or a ground map with its zones, its dock and its rooms beside it. All is read
before the first file is written."""

from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.slam_map_file import save_slam_map
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zones import Zone
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import keep_zones, places_of
from vsx_ros.runs.rooms import write_rooms
from vsx_ros.slam.snapshot import SlamMap


def save_map_of(folder: RunFolder, out: Path) -> None:
    """Save the SLAM map of a run, interrupted or not, with its zones, dock and rooms. Raises MapFileError or
    InputError."""
    saved = folder.checkpoint.read()
    zones, docked = places_of(folder, saved)
    rooms = load_rooms(room_file(folder.path / "map.yaml"))
    save_slam_map(saved.slam_map, out)
    keep_zones(zones, out)
    save_dock(docked, dock_file(out))
    save_rooms(rooms, room_file(out))


def save_continued(slam_map: SlamMap, before: Path | None, out: Path) -> None:
    """Save a SLAM map with the zones, the dock and the rooms of the one that it continues; without one, those of an
    older map at that path are gone. Raises MapFileError."""
    zones, docked = _zones_and_dock(before)
    rooms = load_rooms(room_file(before)) if before is not None else None
    save_slam_map(slam_map, out)
    save_zones(zones, zone_file(out))
    save_dock(docked, dock_file(out))
    save_rooms(rooms, room_file(out))


def copy_places(map_file: Path, grid: OccupancyGrid, out: Path, config: Config) -> None:
    """Write the zones, the dock and the rooms of a map beside a ground map that was made from it. Raises
    MapFileError."""
    zones, docked = _zones_and_dock(map_file)
    save_zones(zones, zone_file(out))
    save_dock(docked, dock_file(out))
    write_rooms(grid, out, config, map_file)


def _zones_and_dock(before: Path | None) -> tuple[list[Zone], SE2 | None]:
    return ([], None) if before is None else (load_zones(zone_file(before)), load_dock(dock_file(before)))
