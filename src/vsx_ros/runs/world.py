"""Emulated worlds by name or file."""

from pathlib import Path

from vsx_ros.errors import ConfigError
from vsx_ros.io.map_file import is_map_file, load_map, load_plan
from vsx_ros.sim.generate import GENERATORS, generate_world, world_from_grid
from vsx_ros.sim.world import World
from vsx_ros.sim.world_file import load_world


def open_world(name: str, seed: int) -> World:
    """A generator's world by name and seed, or a world.yaml, or a map (wall pictures by seed): a map_server map.yaml,
    or only a floor plan, .png or .pgm with 5 cm per pixel. Raises ConfigError for an unknown name or a malformed world
    file, MapFileError for an unusable map."""
    if name in GENERATORS:
        return generate_world(name, seed)
    path = Path(name)
    if path.suffix in (".png", ".pgm") and path.is_file():
        grid = load_map(path) if path.with_suffix(".yaml").exists() else load_plan(path)
        return world_from_grid(grid, path.stem, seed)
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        generator = f"a generator ({', '.join(GENERATORS)})"
        raise ConfigError(f"world {name!r} is neither {generator} nor an existing world.yaml, map.yaml or .png")
    return world_from_grid(load_map(path), path.stem, seed) if is_map_file(path) else load_world(path)
