"""Seeded buildings: lab (12 m x 8 m), office, corridor, and building (40 m x 25 m, 24 to 34 rooms). Same name and
seed, same world. Nothing is tuned by the worlds made of maps of real buildings (``map_import``)."""

import numpy as np
from msgspec.structs import replace

from vsx_ros.errors import ConfigError
from vsx_ros.sim.interior import decorated, furnished, random_materials, wall_material
from vsx_ros.sim.truth import with_start
from vsx_ros.sim.world import Light, Origin, Outline, Point, Start, Wall, World

Rng = np.random.Generator

HEIGHT_M = 2.6  # of a storey
# The building: two corridors with rooms on both sides, joined by a third; where its walls run across.
_BUILDING_M = (40.0, 25.0)
_CORRIDORS_M = ((5.6, 7.8), (17.2, 19.4))
_CROSSING_M = (19.0, 21.2)
_MIDDLE_M = 12.5


def _partition(rng: Rng, x: float, depth: float, gaps: int) -> list[Wall]:
    """A wall across the room at x with gaps 1.1 to 1.6 m wide."""
    cuts, span = [0.0], depth / gaps
    for k in range(gaps):
        width = float(rng.uniform(1.1, 1.6))
        low = k * span + float(rng.uniform(0.15, max(0.2, span - width - 0.3)))
        cuts += [low, low + width]
    cuts.append(depth)
    material = wall_material(rng)
    return [_wall(material, (x, a), (x, b)) for a, b in zip(cuts[::2], cuts[1::2]) if b - a > 0.15]


def ceiling_lights(x0: float, y0: float, x1: float, y1: float) -> list[Light]:
    """Lamps under the ceiling about every 3 m."""
    xs, ys = np.arange(x0 + 1.5, x1, 3.0), np.arange(y0 + 1.2, y1, 2.5)
    return [Light(x=float(x), y=float(y), z=HEIGHT_M - 0.1, strength=0.9) for x in xs for y in ys]


def shell(rng: Rng, origin: Origin, loops: list[list[Point]], start: Point) -> World:
    """An empty building of outlines [m], free space to their left."""
    rooms = [
        Outline(points=loop, height=HEIGHT_M, material=[wall_material(rng) for _ in loop], skirting="skirting")
        for loop in loops
    ]
    xs, ys = zip(*(point for loop in loops for point in loop))
    return World(
        generator=origin,
        start=Start(x=start[0], y=start[1], theta_rad=0.0),
        ceiling_height=HEIGHT_M,
        floor="floor",
        ceiling="ceiling",
        materials=random_materials(rng),
        outlines=rooms,
        lights=ceiling_lights(min(xs), min(ys), max(xs), max(ys)),
    )


def _shell(rng: Rng, name: str, seed: int, width: float, depth: float) -> World:
    corners: list[Point] = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    return shell(rng, Origin(name=name, seed=seed), [corners], (1.2, depth / 2))


def _lab(rng: Rng, seed: int) -> World:
    world = _shell(rng, "lab", seed, 12.0, 8.0)
    walls = _partition(rng, float(rng.uniform(5.0, 7.5)), 8.0, int(rng.integers(1, 3)))
    numbers = int(rng.integers(6, 13)), int(rng.integers(1, 3)), int(rng.integers(1, 4))
    return decorated(rng, furnished(rng, replace(world, walls=walls), *numbers), 1.5)


def _office(rng: Rng, seed: int) -> World:
    world = _shell(rng, "office", seed, 20.0, 12.0)
    walls = [wall for x in (5.0, 10.0, 15.0) for wall in _partition(rng, x, 12.0, 2)]
    return decorated(rng, furnished(rng, replace(world, walls=walls), 14, 4, 3), 1.7)


def _corridor(rng: Rng, seed: int) -> World:
    return decorated(rng, furnished(rng, _shell(rng, "corridor", seed, 16.0, 2.4), 3, 0, 1), 1.5)


def _building(rng: Rng, seed: int) -> World:
    world = _shell(rng, "building", seed, *_BUILDING_M)
    (width, depth), (left, right) = _BUILDING_M, _CROSSING_M
    (low, below), (above, high) = _CORRIDORS_M
    walls = [*_room_row(rng, low, 0.0, 0.0, width), *_room_row(rng, high, depth, 0.0, width)]
    for corridor in (below, above):
        for x0, x1 in ((0.0, left), (right, width)):
            walls += _room_row(rng, corridor, _MIDDLE_M, x0, x1)
    walls += [_wall(wall_material(rng), (x0, _MIDDLE_M), (x1, _MIDDLE_M)) for x0, x1 in ((0.0, left), (right, width))]
    walls += [_wall(wall_material(rng), (x, below), (x, above)) for x in (left, right)]
    start = Start(x=3.0, y=0.5 * (low + below), theta_rad=0.0)
    return decorated(rng, furnished(rng, replace(world, walls=walls, start=start), 36, 8, 4), 1.6)


def _room_row(rng: Rng, y: float, y_back: float, x0: float, x1: float) -> list[Wall]:
    """Rooms from x0 to x1 between a corridor's wall at y, with a door for each, and their back at y_back."""
    count = int(rng.integers(round((x1 - x0) / 6.5), round((x1 - x0) / 4.5) + 1))
    widths = rng.uniform(0.8, 1.2, count)
    edges = x0 + (x1 - x0) * np.concatenate([[0.0], np.cumsum(widths / widths.sum())])
    cuts = [x0]
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist()):
        door = float(rng.uniform(1.1, 1.5))
        low = float(rng.uniform(a + 0.4, b - door - 0.4))
        cuts += [low, low + door]
    cuts.append(x1)
    walls = [_wall(wall_material(rng), (a, y), (b, y)) for a, b in zip(cuts[::2], cuts[1::2])]
    return walls + [_wall(wall_material(rng), (x, min(y, y_back)), (x, max(y, y_back))) for x in edges[1:-1].tolist()]


def _wall(material: str, a: Point, b: Point) -> Wall:
    return Wall(points=[a, b], thickness=0.12, height=HEIGHT_M, material=material, skirting="skirting")


GENERATORS = {"lab": _lab, "office": _office, "corridor": _corridor, "building": _building}


def generate_world(name: str, seed: int) -> World:
    """A world by generator name and seed. Raises ConfigError for an unknown name or a negative seed."""
    if name not in GENERATORS:
        raise ConfigError(f"there is no world generator {name!r}; choose one of {', '.join(GENERATORS)}")
    if seed < 0:
        raise ConfigError(f"world seed {seed} must not be negative")
    rng = np.random.default_rng([seed, list(GENERATORS).index(name)])
    return with_start(rng, GENERATORS[name](rng, seed))
