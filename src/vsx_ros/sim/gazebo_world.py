"""From an SDF file to an emulated world, with every check that needs no picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vsx_ros.errors import ConfigError
from vsx_ros.sim.gazebo.assemble import Parts, assemble
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.sdf import read_layout
from vsx_ros.sim.mesh_world import MAX_AREA_M2, MeshWorld, floor_height, ground_bounds
from vsx_ros.sim.truth import TOUCHING_M, checked_start, middle_of_largest_room
from vsx_ros.sim.world import Start

SUFFIXES = ".world", ".sdf"


def load_gazebo(path: Path, folders: Sequence[Path], start: Start | None = None) -> MeshWorld:
    """The world of an SDF file. folders: where models are looked for; also beside the file. start: by default the
    middle of its largest room. Raises InputError for files that cannot be read, ConfigError for a world without floor
    or without anything to see, and for a start where the robot does not fit."""
    path = path.resolve()
    search, budget = _search(path, folders), Budget()
    layout = read_layout(path, search, budget)
    parts = assemble(layout, search, budget)
    told = f" (its parts: {'; '.join(parts.remarks[:3])})" if parts.remarks else ""
    if not len(parts.solids):
        raise ConfigError(f"world {path} holds nothing solid{told}; give it models with collisions")
    floor_z_m = floor_height(parts)
    if floor_z_m is None:
        raise ConfigError(f"world {path} has no floor{told}; add one, e.g. <include> model://ground_plane")
    bounds = ground_bounds(parts.solids, floor_z_m)
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    if area <= 0.0:
        raise ConfigError(f"world {path} has a floor and nothing on it{told}; a camera would see nothing: add models")
    if area > MAX_AREA_M2:
        raise ConfigError(f"world {path} covers {area:.0f} m2, at most {MAX_AREA_M2:g} m2 are emulated; leave some out")
    world = MeshWorld(
        name=path.stem,
        file=path,
        folders=search.folders,
        start=start or Start(x=bounds[0], y=bounds[1], theta_rad=0.0),
        floor_z_m=floor_z_m,
        obstacle_bounds=bounds,
        parts=_lowered(parts, floor_z_m),
        lamps=[lamp._replace(position=lamp.position - np.array([0.0, 0.0, floor_z_m])) for lamp in layout.lamps],
        ambient=layout.ambient,
        sky=layout.sky,
    )
    return (
        world.starting_at(middle_of_largest_room(world))
        if start is None
        else checked_start(world, world.name, TOUCHING_M)
    )


def gazebo_files(path: Path, folders: Sequence[Path]) -> list[Path]:
    """The SDF file, the files of its models, and of its meshes in no model with the textures beside them. Raises
    InputError for an SDF file that cannot be read."""
    path = path.resolve()
    search = _search(path, folders)
    read_layout(path, search, Budget())
    return [path, *search.used()]


def _search(path: Path, folders: Sequence[Path]) -> ModelFolders:
    beside = (path.parent, path.parent / "models", path.parent.parent / "models", path.parent.parent)
    return ModelFolders([*folders, *beside])


def _lowered(parts: Parts, by_m: float) -> Parts:
    down = np.array([0.0, 0.0, by_m])
    seen = parts.seen._replace(corners=(parts.seen.corners - down.astype(np.float32)))
    return parts._replace(seen=seen, solids=parts.solids - down)
