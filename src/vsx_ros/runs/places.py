"""Zones and dock of a run: given at its start, read beside the map that it continues, written beside its own."""

from collections.abc import Sequence
from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.room_file import room_file
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.rooms import OF_ONE_RUN, look_into
from vsx_ros.slam.snapshot import SlamMap, snapshot


def place_files(folder: RunFolder) -> tuple[Path, Path]:
    """The paths of the zones and the dock beside the ground map of a run."""
    beside = folder.path / "map.yaml"
    return zone_file(beside), dock_file(beside)


def given_zones(path: Path) -> list[Zone]:
    """The zones of a file that the user names. Raises ConfigError when it does not exist, MapFileError for a damaged
    one."""
    if not path.is_file():
        raise ConfigError(f"there is no file of zones {path}; 'vsx zone --help' says how one is made")
    return load_zones(path)


def begin_places(ground: MappedGround, map_file: Path | None, zones: Path | None, room: str | None) -> None:
    """Take over zones and dock beside a map that is continued, then the zones of a file of the user's; of two with one
    name the latter counts. room: explore only this room of the map. Raises as ``given_zones`` and ``room_beside``."""
    beside = load_zones(zone_file(map_file)) if map_file is not None else []
    for zone in [*beside, *(given_zones(zones) if zones is not None else [])]:
        ground.zones.add(zone)
    if map_file is not None and (docked := load_dock(dock_file(map_file))) is not None:
        ground.docked(docked)
    if map_file is not None and room:
        look_into(ground, map_file, room)


def resume_places(ground: MappedGround, folder: RunFolder) -> None:
    """Take over the zones and the dock beside the ground map of a resumed run if they are others than its checkpoint
    knew, as after 'vsx zone'. Raises MapFileError."""
    zones, dock = place_files(folder)
    if folder.checkpoint.is_older_than(zones):
        ground.zones.replace(load_zones(zones), kept=_is_of_one_run)
    if folder.checkpoint.is_older_than(dock) and (docked := load_dock(dock)) is not None:
        ground.docked(docked)


def zones_beside(map_file: Path) -> list[Zone]:
    """The zones of a map; of a run's own ground map those with which its next session goes on. Raises MapFileError or
    InputError."""
    folder = RunFolder(map_file.parent)
    if map_file.name != "map.yaml" or folder.checkpoint.is_older_than(zone_file(map_file)):
        return load_zones(zone_file(map_file))
    return places_of(folder, folder.checkpoint.read())[0] if folder.checkpoint.exists else []


def draw_zones(zones: Sequence[Zone], map_file: Path) -> None:
    """Write the zones that an operator changed beside a map. Those of a run differ from the file with which its last
    session began, even if that had the same: in between it had others, and the file would not count. Raises
    MapFileError."""
    path = zone_file(map_file)
    save_zones(zones, path)
    checkpoint = RunFolder(map_file.parent).checkpoint
    if map_file.name == "map.yaml" and checkpoint.exists and not checkpoint.is_older_than(path):
        save_zones(zones, path, again=True)


def places_of(folder: RunFolder, saved: CheckpointData) -> tuple[list[Zone], SE2 | None]:
    """Zones and dock of a run: from the files beside its ground map if they are others than the checkpoint knew, else
    from that. Raises MapFileError or InputError."""
    (zones_path, dock_path), ground = place_files(folder), MappedGround(Config())
    seen = snapshot(saved.slam_map.view)
    if saved.state:
        ground.restore(saved.state)
    zones, docked = list(ground.zones_in(seen)), ground.dock(seen)
    if folder.checkpoint.is_older_than(zones_path):
        zones = load_zones(zones_path)
    if folder.checkpoint.is_older_than(dock_path):
        docked = load_dock(dock_path)
    return zones, docked


def write_places(ground: MappedGround, slam_map: SlamMap | None, map_file: Path) -> None:
    """Write zones and dock beside a map, where they are in it; nothing without a map. Raises MapFileError."""
    if slam_map is not None:
        now = snapshot(slam_map.view)
        keep_zones(ground.zones_in(now), map_file)
        save_dock(ground.dock(now), dock_file(map_file))


def keep_zones(zones: Sequence[Zone], map_file: Path) -> None:
    """Write the zones beside a map, without that of the room which only one run was to explore: the next run in this
    map explores all of it. Raises MapFileError."""
    save_zones([zone for zone in zones if not _is_of_one_run(zone)], zone_file(map_file))


def _is_of_one_run(zone: Zone) -> bool:
    return zone.kind is ZoneKind.LOOK and zone.name.startswith(OF_ONE_RUN)


def rooms_known(folder: RunFolder | None, load_map: str) -> Path | None:
    """The map beside which the rooms are whose names and numbers a run goes on with: its own once it has written some,
    before that the loaded one; None without both."""
    own = folder.path / "map.yaml" if folder is not None else None
    if load_map and not (own is not None and room_file(own).exists()):
        return Path(load_map)
    return own
