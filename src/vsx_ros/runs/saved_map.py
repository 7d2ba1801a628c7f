"""Maps that leave their run: a SLAM map or a ground map with its zones, its dock and its rooms beside it."""

from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.slam_map_file import save_slam_map
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import keep_zones, places_of
from vsx_ros.runs.rooms import write_rooms
from vsx_ros.slam.snapshot import SlamMap


def save_map_of(folder: RunFolder, out: Path) -> None:
    """Save the SLAM map of a run, interrupted or not, with its zones, dock and rooms. Raises MapFileError or
    InputError."""
    saved = folder.checkpoint.read()
    save_slam_map(saved.slam_map, out)
    zones, docked = places_of(folder, saved)
    rooms = load_rooms(room_file(folder.path / "map.yaml"))
    keep_zones(zones, out)
    save_dock(docked, dock_file(out))
    save_rooms(rooms, room_file(out))


def save_continued(slam_map: SlamMap, before: Path | None, out: Path) -> None:
    """Save a SLAM map with the zones, the dock and the rooms of the one that it continues; without one, those of an
    older map at that path are gone. Raises MapFileError."""
    save_slam_map(slam_map, out)
    _copy_zones_and_dock(before, out)
    save_rooms(load_rooms(room_file(before)) if before is not None else None, room_file(out))


def copy_places(map_file: Path, grid: OccupancyGrid, out: Path, config: Config) -> None:
    """Write the zones, the dock and the rooms of a map beside a ground map that was made from it. Raises
    MapFileError."""
    _copy_zones_and_dock(map_file, out)
    write_rooms(grid, out, config, map_file)


def _copy_zones_and_dock(before: Path | None, out: Path) -> None:
    save_zones(load_zones(zone_file(before)) if before is not None else [], zone_file(out))
    save_dock(load_dock(dock_file(before)) if before is not None else None, dock_file(out))
