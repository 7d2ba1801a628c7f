"""The contents of an emulated world's rooms, drawn by seed: furniture that leaves every passage open, posters on walls,
and the materials of surfaces."""

import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from vsx_ros.sim.truth import is_connected
from vsx_ros.sim.world import Box, Cylinder, Material, Point, Poster, Table, TextureKind, Tint, Wall, World

Rng = np.random.Generator
TRIES = 40  # places drawn for a thing before it is left out
JAMB_GAP_M = 0.6  # from a door's jambs, so that the base gets through
POSTERS = 12  # different ones
# RGB: of paint and floors, and of prints.
WARM: list[Tint] = [(1.0, 0.95, 0.85), (0.9, 0.95, 1.0), (1.0, 1.0, 0.96), (0.93, 1.0, 0.92), (1.0, 0.9, 0.88)]
VIVID: list[Tint] = [(1.0, 0.8, 0.6), (0.7, 0.85, 1.0), (0.9, 1.0, 0.75), (1.0, 0.75, 0.8), (1.0, 1.0, 1.0)]

Stretches = list[tuple[Point, Point]]  # straight parts of walls to hang things on; the free side is to the left


def _box(rng: Rng, x: float, y: float) -> Box:
    length, width, height = (float(v) for v in rng.uniform([0.4, 0.4, 0.4], [1.2, 0.8, 1.4]))
    kinds = ["print0", "print1", "print2", "print3", "wood", "paint", "grey"]
    material = kinds[int(rng.choice(7, p=[0.16, 0.16, 0.16, 0.16, 0.12, 0.12, 0.12]))]
    yaw = float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0, math.pi)]))
    return Box(x=x, y=y, yaw_rad=yaw, length=length, width=width, height=height, material=material)


def _table(rng: Rng, x: float, y: float) -> Table:
    yaw = float(rng.choice([0.0, 0.5 * math.pi]))
    length, width = float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.7, 0.9))
    return Table(x=x, y=y, yaw_rad=yaw, length=length, width=width, material="wood")


def _pillar(rng: Rng, x: float, y: float) -> Cylinder:
    radius, height = float(rng.uniform(0.15, 0.3)), float(rng.uniform(0.5, 1.3))
    material = ["print0", "print2", "brick", "grey"][int(rng.integers(4))]
    return Cylinder(x=x, y=y, radius=radius, height=height, material=material)


def jambs(world: World) -> list[Point]:
    """Ends of free-standing walls that do not touch the building's outline: the sides of its doors."""
    x0, y0, x1, y1 = world.bounds
    ends = [end for wall in world.walls for end in (wall.points[0], wall.points[-1])]
    return [(x, y) for x, y in ends if x0 + 0.01 < x < x1 - 0.01 and y0 + 0.01 < y < y1 - 0.01]


def _touching(world: World) -> bool:
    """Whether furniture stands inside other furniture, in a partition or in the way of a door."""
    solids = [(b.x, b.y, 0.5 * math.hypot(b.length, b.width)) for b in world.boxes]
    solids += [(t.x, t.y, 0.5 * math.hypot(t.length, t.width)) for t in world.tables]
    solids += [(c.x, c.y, c.radius) for c in world.cylinders]
    near = any(
        math.hypot(ax - bx, ay - by) < ar + br for i, (ax, ay, ar) in enumerate(solids) for bx, by, br in solids[:i]
    )
    in_wall = any(_in_partition(wall, *solid) for wall in world.walls for solid in solids)
    at_door = any(math.hypot(x - px, y - py) < r + JAMB_GAP_M for x, y, r in solids for px, py in jambs(world))
    return near or in_wall or at_door


def _in_partition(wall: Wall, x: float, y: float, r: float) -> bool:
    """Whether a disc reaches into a wall along one of the axes."""
    across = 1 if wall.points[0][1] == wall.points[-1][1] else 0
    along = [p[1 - across] for p in wall.points]
    place = (x, y)
    near = abs(place[across] - wall.points[0][across]) < r + 0.05
    return near and min(along) - r < place[1 - across] < max(along) + r


def furnished(rng: Rng, world: World, boxes: int, tables: int, cylinders: int) -> World:
    """Add furniture so that the passages stay open; a piece that does not fit after many tries is left out."""
    x0, y0, x1, y1 = world.bounds
    for kind, make in [("boxes", _box)] * boxes + [("tables", _table)] * tables + [("cylinders", _pillar)] * cylinders:
        for _ in range(TRIES):
            x, y = float(rng.uniform(x0 + 0.5, x1 - 0.5)), float(rng.uniform(y0 + 0.5, y1 - 0.5))
            trial = replace(world, **{kind: [*getattr(world, kind), make(rng, x, y)]})
            clear = math.hypot(x - world.start.x, y - world.start.y) > 1.0
            if clear and not _touching(trial) and is_connected(trial):
                world = trial
                break
    return world


def random_materials(rng: Rng) -> dict[str, Material]:
    """Floor, ceiling, walls, furniture and a dozen posters."""

    def seed() -> int:
        return int(rng.integers(1 << 30))

    def tint(choices: list[Tint]) -> Tint:
        return choices[int(rng.integers(len(choices)))]

    floor: TextureKind = "carpet" if rng.random() < 0.5 else "tiles"
    brightness = float(rng.uniform(0.36, 0.5))
    materials = {
        "floor": Material(kind=floor, seed=seed(), brightness=brightness, texel_m=0.004, tint=tint(WARM)),
        "ceiling": Material(kind="panels", seed=seed(), brightness=0.8, texel_m=0.6 * 4 / 256),
        "skirting": Material(kind="plain", brightness=float(rng.choice([0.15, 0.25, 0.85]))),
        "paint": Material(kind="paint", seed=seed(), brightness=float(rng.uniform(0.6, 0.75)), tint=tint(WARM)),
        "wallpaper": Material(kind="wallpaper", seed=seed(), brightness=0.62, texel_m=0.005, tint=tint(WARM)),
        "brick": Material(kind="brick", seed=seed(), brightness=0.5, contrast=0.8, tint=(1.0, 0.8, 0.7)),
        "wood": Material(kind="wood", seed=seed(), brightness=0.5, tint=(1.0, 0.85, 0.65)),
        "grey": Material(kind="plain", brightness=float(rng.uniform(0.3, 0.6))),
    }
    for k in range(4):
        bright = float(rng.uniform(0.4, 0.6))
        materials[f"print{k}"] = Material(kind="print", seed=seed(), brightness=bright, texel_m=0.003, tint=tint(VIVID))
    for k in range(POSTERS):
        materials[f"poster{k}"] = Material(kind="poster", seed=seed(), brightness=0.55, tint=tint(VIVID))
    return materials


def wall_material(rng: Rng) -> str:
    """Plain paint for 40 % of the walls, wallpaper or brick for the others."""
    return ["paint", "wallpaper", "brick"][int(rng.choice(3, p=[0.4, 0.42, 0.18]))]


def _stretches(world: World) -> Stretches:
    """Every wall face of outlines and free-standing walls, free side to the left."""
    result: Stretches = []
    for outline in world.outlines:
        result += list(zip(outline.points, [*outline.points[1:], outline.points[0]]))
    for wall in world.walls:
        for (ax, ay), (bx, by) in zip(wall.points[:-1], wall.points[1:]):
            length = math.hypot(bx - ax, by - ay)
            nx, ny = -0.5 * wall.thickness * (by - ay) / length, 0.5 * wall.thickness * (bx - ax) / length
            result.append(((ax + nx, ay + ny), (bx + nx, by + ny)))
            result.append(((bx - nx, by - ny), (ax - nx, ay - ny)))
    return result


class _Hanging(NamedTuple):
    """Ranges of random values [m]. first: distance of the first thing from the corner. width, height. middle: height of
    its centre. spacing: distance to the next, as a share of the spacing. end: least distance to the far corner. raised:
    share of its height by which a thing hangs higher."""

    first: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]
    middle: tuple[float, float]
    spacing: tuple[float, float]
    end: float
    raised: float


_POSTERS = _Hanging(
    first=(0.5, 0.9), width=(0.5, 0.9), height=(0.5, 1.1), middle=(0.55, 1.1), spacing=(0.8, 1.2), end=0.5, raised=0.3
)
# Small things low on the walls: sockets, signs, vents.
_NOTICES = _Hanging(
    first=(0.2, 0.6),
    width=(0.12, 0.34),
    height=(0.12, 0.34),
    middle=(0.3, 0.6),
    spacing=(0.6, 1.4),
    end=0.2,
    raised=0.0,
)


def _hung(rng: Rng, stretches: Stretches, kind: _Hanging, spacing_m: float) -> list[Poster]:
    posters: list[Poster] = []
    for (ax, ay), (bx, by) in stretches:
        length, yaw = math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
        at = float(rng.uniform(*kind.first))
        while at < length - kind.end:
            width, height = float(rng.uniform(*kind.width)), float(rng.uniform(*kind.height))
            x, y = ax + at * math.cos(yaw), ay + at * math.sin(yaw)
            z = float(rng.uniform(*kind.middle)) + kind.raised * height
            material = f"poster{int(rng.integers(POSTERS))}"
            facing = yaw + 0.5 * math.pi
            posters.append(Poster(x=x, y=y, z=z, yaw_rad=facing, width=width, height=height, material=material))
            at += float(rng.uniform(*kind.spacing)) * spacing_m
    return posters


def decorated(rng: Rng, world: World, spacing_m: float) -> World:
    """The world with posters about every spacing_m along its walls, and small notices below them."""
    stretches = _stretches(world)
    posters = _hung(rng, stretches, _POSTERS, spacing_m)
    return replace(world, posters=posters + _hung(rng, stretches, _NOTICES, 1.1))
