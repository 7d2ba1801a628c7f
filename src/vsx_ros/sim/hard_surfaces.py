"""Hard things that change how a generated building looks and what stands in it. Each change is idempotent, so that a
changed building can be written to a file and read again."""

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import FloatArray
from vsx_ros.sim.truth import gap_to_walls
from vsx_ros.sim.world import Material, Point, Table, TextureKind, World

WHITE, REPEATED = "white wall", "repeated"  # names of materials
OTHERS = {"mirror", "outside"}  # what hangs in place of pictures
_REPEATED_TEXELS = 512  # along a side of the pattern
_HANGS_WITHIN_M = 0.1  # of a picture from its wall
_BECOME_TABLES = "wood", "paint", "grey"  # boxes of these materials
_TABLE_LEAST_M = 0.4  # height


def _faces(world: World) -> list[tuple[Point, Point]]:
    """The sides of the outlines, then the free-standing walls, by their ends."""
    loops = [outline.points for outline in world.outlines]
    faces = [side for loop in loops for side in zip(loop, loop[1:] + loop[:1])]
    return faces + [(wall.points[0], wall.points[-1]) for wall in world.walls]


def _with_walls(world: World, materials: list[str]) -> World:
    """The world with these materials of its faces."""
    outlines, at = [], 0
    for outline in world.outlines:
        outlines.append(replace(outline, material=materials[at : at + len(outline.points)]))
        at += len(outline.points)
    walls = [replace(wall, material=material) for wall, material in zip(world.walls, materials[at:])]
    return replace(world, outlines=outlines, walls=walls)


def white_walls(world: World, share: float) -> World:
    """The world with this share of its walls white and bare; which ones, says the world's seed."""
    draws = np.random.default_rng([world.generator.seed, 401]).uniform(size=len(_faces(world)))
    bare = draws < share
    old = [material for outline in world.outlines for material in outline.side_materials]
    old += [wall.material for wall in world.walls]
    world = _with_walls(world, [WHITE if white else material for white, material in zip(bare, old)])
    ends = np.array([[*a, *b] for a, b in _faces(world)], float)
    white = [poster for poster in world.posters if _hangs_on(ends[bare], (poster.x, poster.y))]
    materials = world.materials | {WHITE: Material(kind="plain", brightness=0.8)}
    return replace(world, materials=materials, posters=[poster for poster in world.posters if poster not in white])


def _hangs_on(ends: FloatArray, place: Point) -> bool:
    """Whether a picture's place lies on one of the walls (N, 4)."""
    return bool(len(ends)) and float(gap_to_walls(ends, np.array([place]))[0]) < _HANGS_WITHIN_M


def repeated_texture(world: World, period_m: float) -> World:
    """The world with the same pattern on all walls, again every period_m, and no pictures."""
    seed, texel_m = world.generator.seed, period_m / _REPEATED_TEXELS
    pattern = Material(kind="poster", seed=seed, brightness=0.55, texel_m=texel_m)
    world = _with_walls(world, [REPEATED] * len(_faces(world)))
    return replace(world, materials=world.materials | {REPEATED: pattern}, posters=[])


def thin_legs(world: World, thick_cm: float) -> World:
    """The world with table legs of at most this thickness, and such a table in place of each plain box."""
    leg = 0.01 * thick_cm
    tables = [replace(table, leg=min(table.leg, leg)) for table in world.tables]
    for box in world.boxes:
        if box.material in _BECOME_TABLES and box.base_z == 0.0:
            height = max(box.height, _TABLE_LEAST_M)
            sizes = {"length": box.length, "width": box.width, "height": height, "leg": leg}
            tables.append(Table(x=box.x, y=box.y, yaw_rad=box.yaw_rad, material=box.material, **sizes))
    boxes = [box for box in world.boxes if box.material not in _BECOME_TABLES or box.base_z != 0.0]
    return replace(world, tables=tables, boxes=boxes)


def _replaced(world: World, number: float, kind: TextureKind, size_m: Point) -> World:
    """The world with this number of things of a kind and of at least this size in place of pictures."""
    chosen = np.random.default_rng([world.generator.seed, 404]).permutation(len(world.posters))
    free = [k for k in chosen.tolist() if world.posters[k].material not in OTHERS - {kind}][: round(number)]
    posters = list(world.posters)
    for k in free:
        width, height = max(posters[k].width, size_m[0]), max(posters[k].height, size_m[1])
        z = 0.5 * height + 0.1 if kind == "mirror" else max(posters[k].z, 0.5 * height + 0.1)
        posters[k] = replace(posters[k], material=kind, width=width, height=height, z=z)
    return replace(world, posters=posters, materials=world.materials | {kind: Material(kind=kind, brightness=0.6)})


def mirrors(world: World, number: float) -> World:
    """The world with so many mirrors in place of pictures."""
    return _replaced(world, number, "mirror", (0.7, 1.4))


def windows(world: World, number: float) -> World:
    """The world with so many windows in place of pictures, before a bright outside."""
    return _replaced(world, number, "outside", (1.0, 1.1))


def glass_walls(world: World, share: float) -> World:
    """The world with this share of its free-standing walls of glass; which ones, says the world's seed."""
    draws = np.random.default_rng([world.generator.seed, 405]).uniform(size=len(world.walls))
    glass = draws < share
    ends = np.array([[*wall.points[0], *wall.points[-1]] for wall in world.walls], float).reshape(-1, 4)
    walls = [replace(w, material="glass", skirting=None) if clear else w for w, clear in zip(world.walls, glass)]
    posters = [poster for poster in world.posters if not _hangs_on(ends[glass], (poster.x, poster.y))]
    materials = world.materials | {"glass": Material(kind="glass", brightness=0.1)}
    return replace(world, walls=walls, posters=posters, materials=materials)


CHANGES: dict[str, Callable[[World, float], World]] = {
    "repeated-texture": repeated_texture, "white-walls": white_walls, "glass-walls": glass_walls,
    "mirrors": mirrors, "windows": windows, "thin-legs": thin_legs,
}  # fmt: skip
"""By name, in the order in which they are made."""


def changed(world: World) -> World:
    """The world with the surfaces that its hard things ask for."""
    for name, change in CHANGES.items():
        if name in world.hard:
            world = change(world, world.hard[name])
    return world
