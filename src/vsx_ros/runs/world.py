"""Emulated worlds by name or file, and their files."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from vsx_ros.errors import ConfigError, VsxError, did_you_mean, explained
from vsx_ros.io.atomic import write_text
from vsx_ros.io.map_file import is_map_file, load_map, load_plan, map_image
from vsx_ros.sim import gazebo_world
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.generate import GENERATORS, generate_world, world_from_grid
from vsx_ros.sim.hard_things import named_things
from vsx_ros.sim.lighting import light_named
from vsx_ros.sim.truth import with_start
from vsx_ros.sim.world_file import check_building, load_world, named_files, names_gazebo, with_hard_things, world_yaml

_PICTURES = ".png", ".pgm"
_SUFFIXES = *gazebo_world.SUFFIXES, *_PICTURES, ".yaml", ".yml"
MODEL_PATHS = "GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH"  # of the environment


def model_folders(given: Sequence[Path] = ()) -> list[Path]:
    """Where Gazebo's models are looked for: the given folders, those of the environment, and Gazebo's own."""
    named = [Path(folder) for name in MODEL_PATHS for folder in os.environ.get(name, "").split(os.pathsep) if folder]
    return [*given, *named, Path.home() / ".gazebo" / "models"]


def check_world(name: str, models: Sequence[Path] = ()) -> None:
    """Raises ConfigError for the name of no world or light, for folders of models that are not there or not for this
    world, and for a world.yaml that cannot be used, as far as that is known without kernels."""
    _check_name(name, models)
    if _is_world_yaml(Path(name)):
        check_building(Path(name))


def _is_world_yaml(path: Path) -> bool:
    return path.suffix in (".yaml", ".yml") and path.is_file() and not is_map_file(path)


def _check_name(name: str, models: Sequence[Path]) -> None:
    path, (generator, colon, light) = Path(name), name.partition(":")
    for folder in models:
        if path.suffix not in gazebo_world.SUFFIXES and not (_is_world_yaml(path) and names_gazebo(path)):
            raise ConfigError(f"--models {folder} is for a Gazebo world, and {name} is none; leave it out")
        if not folder.is_dir():
            raise ConfigError(f"--models {folder}: there is no such folder")
    if generator in GENERATORS:
        if colon:
            light_named(light, 0)
        return
    if path.suffix in _SUFFIXES and path.is_file():
        return
    files = [str(file) for file in sorted(path.parent.glob("*.*")) if file.suffix in _SUFFIXES]
    raise ConfigError(
        f"world {name!r} is neither a generator ({', '.join(GENERATORS)}) nor an existing world.yaml, .world, map.yaml "
        f"or .png{did_you_mean(name, [*GENERATORS, *files])}"
    )


def open_world(
    name: str, seed: int, models: Sequence[Path] = (), hard: Sequence[str] = (), where: str = "--with"
) -> EmulatedWorld:
    """A generator's world by name and seed, in its usual light or another one ('lab:night'), or a world.yaml, or a
    Gazebo file (.world, .sdf; start by seed; models: folders of its models), or a map (wall pictures by seed): a
    map_server map.yaml, or only a floor plan, .png or .pgm with 5 cm per pixel. Raises ConfigError for an unknown name
    or light or a malformed world file, InputError for an unusable Gazebo file, MapFileError for an unusable map. hard:
    words NAME=AMOUNT of hard things that the world gets; where: what named these."""
    _check_name(name, models)
    return with_hard_things(_opened(name, seed, models), named_things(hard, where), where)


class WorldError(VsxError):
    """A world cannot be opened; another time its files may be there, or mended."""


def world_of(name: str, seed: int) -> EmulatedWorld:
    """The world of a task among many, as ``open_world``. Raises WorldError whatever is wrong with it."""
    try:
        return open_world(name, seed)
    except VsxError as error:
        raise WorldError(str(error)) from error


def _opened(name: str, seed: int, models: Sequence[Path]) -> EmulatedWorld:
    generator, colon, light = name.partition(":")
    if generator in GENERATORS:
        made = generate_world(generator, seed)
        return replace(made, lighting=light_named(light, seed)) if colon else made
    path = Path(name)
    if path.suffix in gazebo_world.SUFFIXES:
        return with_start(np.random.default_rng([seed, 0]), gazebo_world.load_gazebo(path, model_folders(models)))
    text = _map_yaml(path)
    if text is not None:
        return world_from_grid(load_map(text), path.stem, seed)
    if path.suffix in _PICTURES:
        return world_from_grid(load_plan(path), path.stem, seed)
    return load_world(path, models, model_folders())


def _map_yaml(path: Path) -> Path | None:
    """The YAML of a map that is given by it, or by a picture beside it; None if there is none."""
    text = path.with_suffix(".yaml") if path.suffix in _PICTURES else path
    return text if text.suffix in (".yaml", ".yml") and text.is_file() and is_map_file(text) else None


def world_files(name: str, models: Sequence[Path] = ()) -> list[Path]:
    """The files that this world is described in: none of a generator's; of a map, its YAML and its picture, too; of a
    Gazebo file, those of its models. Raises MapFileError for a map that names no picture, InputError or ConfigError for
    a Gazebo file or world.yaml that cannot be read."""
    path = Path(name)
    if name.partition(":")[0] in GENERATORS:
        return []
    text = _map_yaml(path)
    if text is not None:
        return [path, text, map_image(text)]
    if path.suffix in gazebo_world.SUFFIXES and path.is_file():
        return gazebo_world.gazebo_files(path, model_folders(models))
    return [path, *(named_files(path, models, model_folders()) if _is_world_yaml(path) else ())]


def save_world(world: EmulatedWorld, path: Path) -> None:
    """Write world.yaml in one step. Raises ConfigError when the file cannot be written; an older one then stays."""
    with explained(ConfigError, f"world file {path} cannot be written", "choose another folder", OSError):
        write_text(path, world_yaml(world), durable=True)
