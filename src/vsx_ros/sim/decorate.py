"""What hangs on walls and what surfaces are made of, drawn by seed."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.sim.world import Material, Point, Poster, TextureKind, Tint, World, changed

Rng = np.random.Generator

POSTERS = 12
WARM: list[Tint] = [(1.0, 0.95, 0.85), (0.9, 0.95, 1.0), (1.0, 1.0, 0.96), (0.93, 1.0, 0.92), (1.0, 0.9, 0.88)]
VIVID: list[Tint] = [(1.0, 0.8, 0.6), (0.7, 0.85, 1.0), (0.9, 1.0, 0.75), (1.0, 0.75, 0.8), (1.0, 1.0, 1.0)]

Stretches = list[tuple[Point, Point]]
"""Straight stretches of wall to hang things on; the free side is to the left."""


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
    """Least and greatest of what is drawn [m]: of the first one's way from the corner, of width, height, middle above
    the floor, and way to the next one as a share of the spacing. end: nothing nearer to the far corner; raised: by so
    much of its height a thing hangs higher."""

    first: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]
    middle: tuple[float, float]
    spacing: tuple[float, float]
    end: float
    raised: float


_POSTERS = _Hanging((0.5, 0.9), (0.5, 0.9), (0.5, 1.1), (0.55, 1.1), (0.8, 1.2), 0.5, 0.3)
# Small things low on the walls: sockets, signs, vents.
_NOTICES = _Hanging((0.2, 0.6), (0.12, 0.34), (0.12, 0.34), (0.3, 0.6), (0.6, 1.4), 0.2, 0.0)


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
    return changed(world, posters=posters + _hung(rng, stretches, _NOTICES, 1.1))
