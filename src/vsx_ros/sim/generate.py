"""Seeded buildings: lab (12 m x 8 m), office, corridor. Same name and seed, same world."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import (
    Box,
    Cylinder,
    Light,
    Material,
    Origin,
    Outline,
    Point,
    Poster,
    Start,
    Table,
    TextureKind,
    Tint,
    Wall,
    World,
    obstacle_segments,
)

Rng = np.random.Generator

HEIGHT_M = 2.6
PASSAGE_RADIUS_M = 0.25
START_AHEAD_M = 1.2
WARM: list[Tint] = [(1.0, 0.95, 0.85), (0.9, 0.95, 1.0), (1.0, 1.0, 0.96), (0.93, 1.0, 0.92), (1.0, 0.9, 0.88)]
VIVID: list[Tint] = [(1.0, 0.8, 0.6), (0.7, 0.85, 1.0), (0.9, 1.0, 0.75), (1.0, 0.75, 0.8), (1.0, 1.0, 1.0)]

Rooms = list[tuple[Point, Point]]
"""Straight stretches of wall that posters may hang on; the free side is to the left."""


def _materials(rng: Rng) -> dict[str, Material]:
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
    for k in range(12):
        materials[f"poster{k}"] = Material(kind="poster", seed=seed(), brightness=0.55, tint=tint(VIVID))
    return materials


def _wall_material(rng: Rng) -> str:
    return ["paint", "wallpaper", "brick"][int(rng.choice(3, p=[0.4, 0.42, 0.18]))]


def _hang_notices(rng: Rng, stretches: Rooms, spacing_m: float) -> list[Poster]:
    """Small things low on the walls: sockets, signs, vents."""
    notices: list[Poster] = []
    for (ax, ay), (bx, by) in stretches:
        length, yaw = math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
        at = float(rng.uniform(0.2, 0.6))
        while at < length - 0.2:
            x, y = ax + at * math.cos(yaw), ay + at * math.sin(yaw)
            width, height = (float(v) for v in rng.uniform(0.12, 0.34, 2))
            z, material = float(rng.uniform(0.3, 0.6)), f"poster{int(rng.integers(12))}"
            facing = yaw + 0.5 * math.pi
            notices.append(Poster(x=x, y=y, z=z, yaw_rad=facing, width=width, height=height, material=material))
            at += float(rng.uniform(0.6, 1.4)) * spacing_m
    return notices


def _hang_posters(rng: Rng, stretches: Rooms, spacing_m: float) -> list[Poster]:
    posters: list[Poster] = []
    for (ax, ay), (bx, by) in stretches:
        length, yaw = math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
        at = float(rng.uniform(0.5, 0.9))
        while at < length - 0.5:
            width, height = float(rng.uniform(0.5, 0.9)), float(rng.uniform(0.5, 1.1))
            x, y = ax + at * math.cos(yaw), ay + at * math.sin(yaw)
            z = float(rng.uniform(0.55, 1.1)) + 0.3 * height
            material = f"poster{int(rng.integers(12))}"
            facing = yaw + 0.5 * math.pi
            posters.append(Poster(x=x, y=y, z=z, yaw_rad=facing, width=width, height=height, material=material))
            at += float(rng.uniform(0.8, 1.2)) * spacing_m
    return posters


def _stretches(world: World) -> Rooms:
    """Every wall face of outlines and free-standing walls, free side to the left."""
    result: Rooms = []
    for outline in world.outlines:
        result += list(zip(outline.points, [*outline.points[1:], outline.points[0]]))
    for wall in world.walls:
        for (ax, ay), (bx, by) in zip(wall.points[:-1], wall.points[1:]):
            length = math.hypot(bx - ax, by - ay)
            nx, ny = -0.5 * wall.thickness * (by - ay) / length, 0.5 * wall.thickness * (bx - ax) / length
            result.append(((ax + nx, ay + ny), (bx + nx, by + ny)))
            result.append(((bx - nx, by - ny), (ax - nx, ay - ny)))
    return result


def _partition(rng: Rng, x: float, y0: float, y1: float, gaps: int) -> list[Wall]:
    """A wall across the room at x with gaps 1.1 to 1.6 m wide."""
    cuts = [y0]
    span = (y1 - y0) / gaps
    for k in range(gaps):
        width = float(rng.uniform(1.1, 1.6))
        low = y0 + k * span + float(rng.uniform(0.15, max(0.2, span - width - 0.3)))
        cuts += [low, low + width]
    cuts.append(y1)
    material = _wall_material(rng)
    return [
        Wall(points=[(x, a), (x, b)], thickness=0.12, height=HEIGHT_M, material=material, skirting="skirting")
        for a, b in zip(cuts[::2], cuts[1::2])
        if b - a > 0.15
    ]


def _box(rng: Rng, x: float, y: float) -> Box:
    length, width, height = (float(v) for v in rng.uniform([0.4, 0.4, 0.4], [1.2, 0.8, 1.4]))
    kinds = ["print0", "print1", "print2", "print3", "wood", "paint", "grey"]
    material = kinds[int(rng.choice(7, p=[0.16, 0.16, 0.16, 0.16, 0.12, 0.12, 0.12]))]
    yaw = float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0, math.pi)]))
    return Box(x=x, y=y, yaw_rad=yaw, length=length, width=width, height=height, material=material)


def _free(world: World) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Where the middle of a robot of radius 0.25 m fits (5 cm cells), and the x and y of columns and rows."""
    grid = ground_truth_grid(world, 0.05, 0.0, 0.6)
    room = (grid.data == FREE).astype(np.uint8)
    fits = cv2.distanceTransform(room, cv2.DIST_L2, 5) * grid.resolution > PASSAGE_RADIUS_M + 0.05
    xs = grid.origin_x + (np.arange(grid.shape[1]) + 0.5) * grid.resolution
    ys = grid.origin_y + (np.arange(grid.shape[0]) + 0.5) * grid.resolution
    return np.asarray(fits, np.bool_), np.asarray(xs, np.float64), np.asarray(ys, np.float64)


def is_connected(world: World) -> bool:
    """Whether a robot of radius 0.25 m can reach every place it fits into, except pockets under 0.1 m2."""
    fits, _, _ = _free(world)
    count, _, statistics, _ = cv2.connectedComponentsWithStats(fits.astype(np.uint8), connectivity=4)
    areas = np.sort(statistics[1:, cv2.CC_STAT_AREA]) * 0.05**2
    return count >= 2 and (count == 2 or float(areas[-2]) < 0.1)


def free_ahead(world: World, x: float, y: float, theta: float) -> float:
    """How far a disc of radius 0.25 m can go straight from a pose before it touches something, at most 6 m [m]."""
    segments = obstacle_segments(world, 0.0, 0.6)
    a, b = segments[:, :2], segments[:, 2:]
    edge = b - a
    for step in np.arange(0.0, 6.0, 0.05):
        p = np.array([x + step * math.cos(theta), y + step * math.sin(theta)])
        ratio = np.clip(((p - a) * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-12), 0, 1)
        gap = p - a - ratio[:, None] * edge
        if float(np.hypot(gap[:, 0], gap[:, 1]).min()) < PASSAGE_RADIUS_M:
            return float(step)
    return 6.0


def _furnish(rng: Rng, world: World, boxes: int, tables: int, cylinders: int) -> World:
    """Add furniture where the passages stay open; what does not fit after many tries is left out."""
    x0, y0, x1, y1 = world.bounds
    wanted = ["box"] * boxes + ["table"] * tables + ["cylinder"] * cylinders
    for kind in wanted:
        for _ in range(30):
            x, y = float(rng.uniform(x0 + 0.5, x1 - 0.5)), float(rng.uniform(y0 + 0.5, y1 - 0.5))
            if kind == "box":
                trial = _with(world, boxes=[*world.boxes, _box(rng, x, y)])
            elif kind == "table":
                yaw = float(rng.choice([0.0, 0.5 * math.pi]))
                length, width = float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.7, 0.9))
                table = Table(x=x, y=y, yaw_rad=yaw, length=length, width=width, material="wood")
                trial = _with(world, tables=[*world.tables, table])
            else:
                radius, height = float(rng.uniform(0.15, 0.3)), float(rng.uniform(0.5, 1.3))
                material = ["print0", "print2", "brick", "grey"][int(rng.integers(4))]
                pillar = Cylinder(x=x, y=y, radius=radius, height=height, material=material)
                trial = _with(world, cylinders=[*world.cylinders, pillar])
            clear = math.hypot(x - world.start.x, y - world.start.y) > 1.0
            if clear and is_connected(trial) and not _touching(trial):
                world = trial
                break
    return world


def _touching(world: World) -> bool:
    """Whether the newest piece of furniture stands inside another or in a partition."""
    solids = [(b.x, b.y, 0.5 * math.hypot(b.length, b.width)) for b in world.boxes]
    solids += [(t.x, t.y, 0.5 * math.hypot(t.length, t.width)) for t in world.tables]
    solids += [(c.x, c.y, c.radius) for c in world.cylinders]
    near = any(
        math.hypot(ax - bx, ay - by) < ar + br for i, (ax, ay, ar) in enumerate(solids) for bx, by, br in solids[:i]
    )
    in_wall = any(
        abs(x - wall.points[0][0]) < r + 0.05
        and min(p[1] for p in wall.points) - r < y < max(p[1] for p in wall.points) + r
        for wall in world.walls
        for x, y, r in solids
    )
    return near or in_wall


def _with(world: World, **changes: object) -> World:
    fields = {name: getattr(world, name) for name in world.__struct_fields__}
    return World(**{**fields, **changes})


def _place_start(rng: Rng, world: World) -> World:
    """Put the start where 1.2 m ahead are free and something printed or hung is in view."""
    fits, xs, ys = _free(world)
    rows, columns = np.nonzero(fits)
    sights = [(p.x, p.y) for p in world.posters] + [(b.x, b.y) for b in world.boxes if b.material.startswith("print")]
    best, best_score = world.start, -1.0
    for _ in range(60):
        k = int(rng.integers(len(rows)))
        x, y = float(xs[columns[k]]), float(ys[rows[k]])
        theta = float(rng.uniform(-math.pi, math.pi))
        ahead = free_ahead(world, x, y, theta)
        if ahead < START_AHEAD_M + 0.3:
            continue
        angles = [math.atan2(sy - y, sx - x) - theta for sx, sy in sights]
        distances = [math.hypot(sx - x, sy - y) for sx, sy in sights]
        seen = sum(1.0 for a, d in zip(angles, distances) if math.cos(a) > 0.92 and 1.0 < d < 5.0)
        score = min(seen, 5.0) + 0.5 * min(ahead, 3.0)
        if score > best_score:
            best, best_score = Start(x=x, y=y, theta_rad=theta), score
    return _with(world, start=best)


def _lights(width: float, depth: float) -> list[Light]:
    xs = np.arange(1.5, width, 3.0)
    ys = np.arange(1.5, depth, 2.5)
    return [Light(x=float(x), y=float(y), z=HEIGHT_M - 0.1, strength=0.9) for x in xs for y in ys]


def _shell(rng: Rng, name: str, seed: int, width: float, depth: float) -> World:
    corners: list[Point] = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    sides = [_wall_material(rng) for _ in corners]
    room = Outline(points=corners, height=HEIGHT_M, material=sides, skirting="skirting")
    return World(
        generator=Origin(name=name, seed=seed),
        start=Start(x=1.2, y=depth / 2, theta_rad=0.0),
        ceiling_height=HEIGHT_M,
        floor="floor",
        ceiling="ceiling",
        materials=_materials(rng),
        outlines=[room],
        lights=_lights(width, depth),
    )


def _decorated(rng: Rng, world: World, spacing_m: float) -> World:
    stretches = _stretches(world)
    posters = _hang_posters(rng, stretches, spacing_m)
    return _with(world, posters=posters + _hang_notices(rng, stretches, 1.1))


def _lab(rng: Rng, seed: int) -> World:
    world = _shell(rng, "lab", seed, 12.0, 8.0)
    world = _with(world, walls=_partition(rng, float(rng.uniform(5.0, 7.5)), 0.0, 8.0, int(rng.integers(1, 3))))
    numbers = int(rng.integers(6, 13)), int(rng.integers(1, 3)), int(rng.integers(1, 4))
    world = _furnish(rng, world, *numbers)
    return _decorated(rng, world, 1.5)


def _office(rng: Rng, seed: int) -> World:
    world = _shell(rng, "office", seed, 20.0, 12.0)
    walls = [wall for x in (5.0, 10.0, 15.0) for wall in _partition(rng, x, 0.0, 12.0, 2)]
    world = _furnish(rng, _with(world, walls=walls), 14, 4, 3)
    return _decorated(rng, world, 1.7)


def _corridor(rng: Rng, seed: int) -> World:
    world = _shell(rng, "corridor", seed, 16.0, 2.4)
    world = _furnish(rng, world, 3, 0, 1)
    return _decorated(rng, world, 1.5)


GENERATORS = {"lab": _lab, "office": _office, "corridor": _corridor}


def generate_world(name: str, seed: int) -> World:
    """A world by generator name and seed. Raises ConfigError for an unknown name or a negative seed."""
    if name not in GENERATORS:
        raise ConfigError(f"there is no world generator {name!r}; choose one of {', '.join(GENERATORS)}")
    if seed < 0:
        raise ConfigError(f"world seed {seed} must not be negative")
    rng = np.random.default_rng([seed, list(GENERATORS).index(name)])
    return _place_start(rng, GENERATORS[name](rng, seed))
