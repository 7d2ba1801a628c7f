"""The zones and the dock of a run: read beside the map that it continues, written beside its own."""

from pathlib import Path

from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.slam.snapshot import SlamMap, snapshot


def read_places(ground: MappedGround, map_file: Path) -> None:
    """Take over zones and dock beside a map that is continued. Raises MapFileError for a damaged file."""
    for zone in load_zones(zone_file(map_file)):
        ground.zones.add(zone)
    if (docked := load_dock(dock_file(map_file))) is not None:
        ground.docked(docked)


def write_places(ground: MappedGround, slam_map: SlamMap | None, map_file: Path) -> None:
    """Write zones and dock beside a map, where they are in it; nothing without a map. Raises MapFileError."""
    if slam_map is not None:
        now = snapshot(slam_map.view)
        save_zones(ground.zones_in(now), zone_file(map_file))
        save_dock(ground.dock(now), dock_file(map_file))
