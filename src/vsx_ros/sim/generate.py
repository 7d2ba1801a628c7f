"""Seeded buildings: lab (12 m x 8 m), office, corridor, and building (40 m x 25 m, 24 to 34 rooms); and any building
from its map, extruded to walls. The same name or map and seed give the same world. Nothing is tuned on the worlds made
from maps of real buildings."""

import cv2
import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import BoolArray, Points2
from vsx_ros.errors import ConfigError, MapFileError
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.sim.interior import decorated, furnished, random_materials, wall_material
from vsx_ros.sim.truth import with_start
from vsx_ros.sim.world import Light, Origin, Outline, Point, Start, Wall, World, signed_area

Rng = np.random.Generator

HEIGHT_M = 2.6  # of a storey
# The building: two corridors with rooms on both sides, joined by a third; coordinates of its walls.
_BUILDING_M = (40.0, 25.0)
_CORRIDORS_M = ((5.6, 7.8), (17.2, 19.4))
_CROSSING_M = (19.0, 21.2)
_MIDDLE_M = 12.5
TOLERANCE_M = 0.06  # of simplified outlines: about a cell
MAX_OBSTACLES, MAX_SIDES = 5000, 20_000  # a robot's own map of a building has some hundreds and some thousands


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
    """Walls of rooms from x0 to x1 between a corridor's wall at y, with one door per room, and their back at y_back."""
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


def world_from_grid(grid: OccupancyGrid, name: str, seed: int) -> World:
    """The largest free region of a map as a building with random surfaces by seed. Raises MapFileError when there is no
    free region of a square metre."""
    rng = np.random.default_rng([seed, 1000])
    corners: list[list[Point]] = [[(x, y) for x, y in loop.tolist()] for loop in free_space_outlines(grid)]
    world = shell(rng, Origin(name=name, seed=seed), corners, _open_spot(grid))
    return with_start(rng, decorated(rng, world, 1.5))


def _largest_free_region(grid: OccupancyGrid) -> BoolArray:
    """(H, W) mask. Raises MapFileError when there is no free region of a square metre."""
    free = (grid.data == FREE).astype(np.uint8)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    areas = statistics[1:, cv2.CC_STAT_AREA] * grid.resolution**2
    if count < 2 or float(areas.max()) < 1.0:
        raise MapFileError("the map has no free region of at least 1 m2; are its thresholds wrong?")
    return np.asarray(labels == 1 + int(np.argmax(areas)))


def _open_spot(grid: OccupancyGrid) -> Point:
    """The place farthest from any obstacle."""
    free = np.pad(_largest_free_region(grid), 1).astype(np.uint8)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)[1:-1, 1:-1]
    x, y = grid.centres(np.array(np.unravel_index(int(np.argmax(distance)), distance.shape)))[0].tolist()
    return x, y


def free_space_outlines(grid: OccupancyGrid) -> list[Points2]:
    """Borders of the largest free region as closed polygons [m], free space to the left, simplified to 6 cm. Raises
    MapFileError when there is no free region of a square metre, or it has too many borders."""
    region = _largest_free_region(grid).astype(np.uint8)
    pieces = cv2.connectedComponents(np.pad(1 - region, 1, constant_values=1), connectivity=8)[0] - 2
    if pieces > MAX_OBSTACLES:
        raise MapFileError(
            f"the map has {pieces} separate obstacles, at most {MAX_OBSTACLES} can be built; clean the picture"
        )
    contours, tree = cv2.findContours(region, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outlines = []
    for contour, links in zip(contours, tree[0]):
        simple = cv2.approxPolyDP(contour, TOLERANCE_M / grid.resolution, True).reshape(-1, 2).astype(float)
        if len(simple) < 3:
            continue
        points = (simple + 0.5) * grid.resolution + np.array([grid.origin_x, grid.origin_y])
        is_hole = links[3] >= 0
        outlines.append(points[::-1] if (signed_area(points) > 0) == is_hole else points)
    sides = sum(len(outline) for outline in outlines)
    if sides > MAX_SIDES:
        raise MapFileError(f"the map's borders have {sides} sides, at most {MAX_SIDES} can be built; smooth it")
    return outlines
