"""Seeded buildings: lab (12 m x 8 m), office, corridor. Same name and seed, same world."""

from __future__ import annotations

import numpy as np

from vsx_ros.errors import ConfigError
from vsx_ros.sim.decorate import decorated, random_materials, wall_material
from vsx_ros.sim.furnish import furnished
from vsx_ros.sim.placement import with_start
from vsx_ros.sim.world import Light, Origin, Outline, Point, Start, Wall, World, changed

Rng = np.random.Generator

HEIGHT_M = 2.6


def _partition(rng: Rng, x: float, y0: float, y1: float, gaps: int) -> list[Wall]:
    """A wall across the room at x with gaps 1.1 to 1.6 m wide."""
    cuts = [y0]
    span = (y1 - y0) / gaps
    for k in range(gaps):
        width = float(rng.uniform(1.1, 1.6))
        low = y0 + k * span + float(rng.uniform(0.15, max(0.2, span - width - 0.3)))
        cuts += [low, low + width]
    cuts.append(y1)
    material = wall_material(rng)
    return [
        Wall(points=[(x, a), (x, b)], thickness=0.12, height=HEIGHT_M, material=material, skirting="skirting")
        for a, b in zip(cuts[::2], cuts[1::2])
        if b - a > 0.15
    ]


def ceiling_lights(x0: float, y0: float, x1: float, y1: float) -> list[Light]:
    """Lamps under the ceiling about every 3 m."""
    xs, ys = np.arange(x0 + 1.5, x1, 3.0), np.arange(y0 + 1.2, y1, 2.5)
    return [Light(x=float(x), y=float(y), z=HEIGHT_M - 0.1, strength=0.9) for x in xs for y in ys]


def _shell(rng: Rng, name: str, seed: int, width: float, depth: float) -> World:
    corners: list[Point] = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    sides = [wall_material(rng) for _ in corners]
    room = Outline(points=corners, height=HEIGHT_M, material=sides, skirting="skirting")
    return World(
        generator=Origin(name=name, seed=seed),
        start=Start(x=1.2, y=depth / 2, theta_rad=0.0),
        ceiling_height=HEIGHT_M,
        floor="floor",
        ceiling="ceiling",
        materials=random_materials(rng),
        outlines=[room],
        lights=ceiling_lights(0.0, 0.0, width, depth),
    )


def _lab(rng: Rng, seed: int) -> World:
    world = _shell(rng, "lab", seed, 12.0, 8.0)
    world = changed(world, walls=_partition(rng, float(rng.uniform(5.0, 7.5)), 0.0, 8.0, int(rng.integers(1, 3))))
    numbers = int(rng.integers(6, 13)), int(rng.integers(1, 3)), int(rng.integers(1, 4))
    world = furnished(rng, world, *numbers)
    return decorated(rng, world, 1.5)


def _office(rng: Rng, seed: int) -> World:
    world = _shell(rng, "office", seed, 20.0, 12.0)
    walls = [wall for x in (5.0, 10.0, 15.0) for wall in _partition(rng, x, 0.0, 12.0, 2)]
    world = furnished(rng, changed(world, walls=walls), 14, 4, 3)
    return decorated(rng, world, 1.7)


def _corridor(rng: Rng, seed: int) -> World:
    world = _shell(rng, "corridor", seed, 16.0, 2.4)
    world = furnished(rng, world, 3, 0, 1)
    return decorated(rng, world, 1.5)


GENERATORS = {"lab": _lab, "office": _office, "corridor": _corridor}


def generate_world(name: str, seed: int) -> World:
    """A world by generator name and seed. Raises ConfigError for an unknown name or a negative seed."""
    if name not in GENERATORS:
        raise ConfigError(f"there is no world generator {name!r}; choose one of {', '.join(GENERATORS)}")
    if seed < 0:
        raise ConfigError(f"world seed {seed} must not be negative")
    rng = np.random.default_rng([seed, list(GENERATORS).index(name)])
    return with_start(rng, GENERATORS[name](rng, seed))
