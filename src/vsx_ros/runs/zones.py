"""The zones and rooms of a run: read beside the map that it continues, written beside its own."""

from pathlib import Path

from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.slam.snapshot import SlamMap, snapshot


def read_zones(ground: MappedGround, map_file: Path) -> None:
    """Take over the zones beside a map that is continued. Raises MapFileError for a damaged file."""
    for zone in load_zones(zone_file(map_file)):
        ground.zones.add(zone)


def write_zones(ground: MappedGround, slam_map: SlamMap | None, map_file: Path) -> None:
    """Write the zones beside a map, where they are in it; nothing without a map. Raises MapFileError."""
    if slam_map is not None:
        save_zones(ground.zones_in(snapshot(slam_map.view)), zone_file(map_file))
