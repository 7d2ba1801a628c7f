"""Maps that leave their run: a SLAM map or a ground map with its zones, its dock and its rooms beside it."""

from pathlib import Path

import numpy as np

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.room_file import load_rooms, room_file, save_rooms
from vsx_ros.io.slam_map_file import save_slam_map
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.anchored_poses import AnchoredPoses
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zones import AnchoredZones, Zone
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import keep_zones
from vsx_ros.runs.rooms import write_rooms
from vsx_ros.slam.snapshot import snapshot


def save_map_of(folder: RunFolder, out: Path) -> None:
    """Save the SLAM map of a run, interrupted or not, with its zones, dock and rooms. Raises MapFileError or
    InputError."""
    saved, beside = folder.checkpoint.read(), folder.path / "map.yaml"
    save_slam_map(saved.slam_map, out)
    zones, docked = _places(folder, saved, beside)
    rooms = load_rooms(room_file(beside))
    keep_zones(zones, out)
    save_dock(docked, dock_file(out))
    if rooms is not None:
        save_rooms(rooms, room_file(out))


def _places(folder: RunFolder, saved: CheckpointData, beside: Path) -> tuple[list[Zone], SE2 | None]:
    """Zones and dock. Of a run that ended in order, those beside its map: they may have been changed since. Else those
    of the checkpoint."""
    if beside.exists() and beside.stat().st_mtime_ns >= (folder.checkpoint.path / "map.zip").stat().st_mtime_ns:
        return load_zones(zone_file(beside)), load_dock(dock_file(beside))
    zones, docks, seen = AnchoredZones(), AnchoredPoses(0.0), snapshot(saved.slam_map.view)
    zones.restore(saved.state)
    docks.restore(saved.state.get("dock", np.zeros((0, 7))))
    docked = next(iter(docks.poses(seen.keyframe_ids, seen.T_world_cams)), None)
    return list(zones.zones(seen.keyframe_ids, seen.T_world_cams)), docked


def copy_places(map_file: Path, grid: OccupancyGrid, out: Path, config: Config) -> None:
    """Write the zones, the dock and the rooms of a map beside a ground map that was made from it. Raises
    MapFileError."""
    save_zones(load_zones(zone_file(map_file)), zone_file(out))
    save_dock(load_dock(dock_file(map_file)), dock_file(out))
    write_rooms(grid, out, config, map_file)
