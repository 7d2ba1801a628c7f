"""world.yaml: its text, reading and checking. It describes a building, or names a Gazebo file and a start in it."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
import yaml

from vsx_ros.errors import ConfigError, reason_of
from vsx_ros.limits import file_text, with_end, yaml_tree
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.gazebo_world import gazebo_files, load_gazebo
from vsx_ros.sim.hard_surfaces import CHANGES, changed
from vsx_ros.sim.hard_things import HARD_THINGS, checked_things
from vsx_ros.sim.mesh_world import MAX_AREA_M2, MeshWorld
from vsx_ros.sim.truth import TOUCHING_M, checked_start
from vsx_ros.sim.world import Box, Outline, Poster, Start, Table, Wall, World

T = TypeVar("T")
MAX_PARTS, MAX_LIGHTS = 20_000, 2000  # a building of 40 x 25 m has some hundreds and a hundred


class GazeboReference(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """gazebo: path of the SDF file; models: folders where its models are looked for; start: without one, the middle of
    its largest room; hard: amounts of hard things by name. Relative paths begin at the folder of the world.yaml."""

    version: Literal[1] = 1
    gazebo: str
    models: list[str] = []
    start: Start | None = None
    hard: dict[str, float] = {}


def _tree(world: EmulatedWorld) -> Any:
    if isinstance(world, MeshWorld):
        models = [str(folder) for folder in world.folders]
        reference = GazeboReference(gazebo=str(world.file), models=models, start=world.start, hard=world.hard)
        tree = msgspec.to_builtins(reference)
    else:
        tree = msgspec.to_builtins(world)
    return {name: part for name, part in tree.items() if part or name not in ("hard", "lighting")}


def world_yaml(world: EmulatedWorld) -> str:
    """The text of world.yaml."""
    text = yaml.safe_dump(_tree(world), sort_keys=False, default_flow_style=None, width=120)
    return with_end("# vsx_ros emulated world; metres, radians\n" + text)


def load_world(path: Path, given: Sequence[Path] = (), usual: Sequence[Path] = ()) -> EmulatedWorld:
    """Read world.yaml, and the Gazebo file if it names one. given, usual: folders where models are looked for before
    and after those that it names. Raises ConfigError naming the entry that is wrong, and what ``load_gazebo``
    raises."""
    tree = _tree_of(path)
    known = _reference(tree, path)
    if known is not None:
        gazebo = load_gazebo(Path(known.gazebo), [*given, *map(Path, known.models), *usual], known.start)
        return with_hard_things(gazebo, known.hard, f"world file {path}")
    building = _converted(tree, World, path)
    return with_hard_things(checked(building, str(path)), building.hard, f"world file {path}")


def check_building(path: Path) -> None:
    """Raises ConfigError as ``load_world``; what is wrong with a Gazebo file that it names is found when it is read."""
    tree = _tree_of(path)
    if _reference(tree, path) is None:
        checked(_converted(tree, World, path), str(path))


def names_gazebo(path: Path) -> bool:
    """Whether a world.yaml names a Gazebo file. Raises ConfigError when it cannot be read."""
    return _reference(_tree_of(path), path) is not None


def named_files(path: Path, given: Sequence[Path], usual: Sequence[Path]) -> list[Path]:
    """The files of the Gazebo world that a world.yaml names; none for a building. Folders and what is raised: as
    ``load_world``."""
    known = _reference(_tree_of(path), path)
    return [] if known is None else gazebo_files(Path(known.gazebo), [*given, *map(Path, known.models), *usual])


def _tree_of(path: Path) -> Any:
    try:
        return yaml_tree(file_text(path))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"world file {path} cannot be read ({reason_of(error)}); 'vsx world' writes one") from error


def _reference(tree: Any, path: Path) -> GazeboReference | None:
    """The reference to a Gazebo file, with its paths from here; None for a building."""
    if not (isinstance(tree, dict) and "gazebo" in tree):
        return None
    known = _converted(tree, GazeboReference, path)
    models = [str(path.parent / folder) for folder in known.models]
    return msgspec.structs.replace(known, gazebo=str(path.parent / known.gazebo), models=models)


def _converted(tree: Any, kind: type[T], path: Path) -> T:
    try:
        return msgspec.convert(tree, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(
            f"world file {path}: {error}; 'vsx world lab --seed 0 --out FILE' writes a valid one"
        ) from error


def with_hard_things(world: EmulatedWorld, things: Mapping[str, float], where: str) -> EmulatedWorld:
    """The world with these hard things, too, and without those of zero; where: what names them. Raises ConfigError as
    ``checked_things``, for one that goes with generated buildings alone, and for zero of one that has changed the
    building."""
    if not things:
        return world
    stays = next((name for name in CHANGES if things.get(name) == 0.0 and world.hard.get(name)), None)
    if stays is not None:
        raise ConfigError(f"{where}: {stays}=0 cannot undo what has changed the building; make the world without it")
    amounts = checked_things({**world.hard, **things}, where)
    hard = {name: amount for name, amount in amounts.items() if amount != 0.0}
    if isinstance(world, MeshWorld):
        wrong = next((name for name in hard if HARD_THINGS[name].generated), None)
        if wrong is not None:
            raise ConfigError(f"{where}: {wrong} goes with generated buildings, not with a Gazebo file; leave it out")
        return dataclasses.replace(world, hard=hard)
    assert isinstance(world, World)
    return changed(msgspec.structs.replace(world, hard=hard))


def checked(world: World, name: str) -> World:
    """The world unchanged. Raises ConfigError for an unknown material, an angle that is not finite, a world too large,
    and a start where no robot fits."""
    _check_size(world, name)
    edges: list[Outline | Wall] = [*world.outlines, *world.walls]
    things: list[Box | Table | Poster] = [*world.boxes, *world.tables, *world.posters]
    for outline in world.outlines:
        if len(outline.side_materials) != len(outline.points):
            raise ConfigError(
                f"world {name}: an outline of {len(outline.points)} sides names {len(outline.side_materials)} "
                "materials; write one material, or one per side"
            )
    used = {world.floor, world.ceiling} | {part.material for part in [*world.walls, *things, *world.cylinders]}
    used |= {material for outline in world.outlines for material in outline.side_materials}
    used |= {edge.skirting for edge in edges if edge.skirting is not None}
    missing = sorted(used - set(world.materials))
    if missing:
        raise ConfigError(f"world {name}: no material called {missing[0]!r}; add it under 'materials'")
    angles = [thing.yaw_rad for thing in things] + [world.start.theta_rad]
    if not all(math.isfinite(angle) for angle in angles):
        raise ConfigError(f"world {name}: an angle is not finite; write radians")
    return checked_start(world, name, TOUCHING_M)


def _check_size(world: World, name: str) -> None:
    """Raises ConfigError for a world that does not fit into the emulator's memory."""
    x0, y0, x1, y1 = world.bounds
    if (x1 - x0) * (y1 - y0) > MAX_AREA_M2:
        raise ConfigError(
            f"world {name}: {x1 - x0:g} x {y1 - y0:g} m are more than {MAX_AREA_M2:g} m2; make its outlines smaller"
        )
    parts = len(world.boxes) + len(world.tables) + len(world.cylinders) + len(world.posters)
    parts += sum(len(outline.points) for outline in world.outlines) + sum(len(wall.points) for wall in world.walls)
    if parts > MAX_PARTS or len(world.lights) > MAX_LIGHTS:
        raise ConfigError(
            f"world {name}: {parts} sides and things and {len(world.lights)} lights, at most {MAX_PARTS} and "
            f"{MAX_LIGHTS} can be drawn; leave some out"
        )
