"""Furniture: boxes, tables and pillars that leave every passage open."""

import math

import numpy as np

from vsx_ros.sim.placement import is_connected
from vsx_ros.sim.world import Box, Cylinder, Point, Table, Wall, World, changed

Rng = np.random.Generator
TRIES = 40
JAMB_GAP_M = 0.6


def _box(rng: Rng, x: float, y: float) -> Box:
    length, width, height = (float(v) for v in rng.uniform([0.4, 0.4, 0.4], [1.2, 0.8, 1.4]))
    kinds = ["print0", "print1", "print2", "print3", "wood", "paint", "grey"]
    material = kinds[int(rng.choice(7, p=[0.16, 0.16, 0.16, 0.16, 0.12, 0.12, 0.12]))]
    yaw = float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0, math.pi)]))
    return Box(x=x, y=y, yaw_rad=yaw, length=length, width=width, height=height, material=material)


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
    """Add furniture where the passages stay open; what does not fit after many tries is left out."""
    x0, y0, x1, y1 = world.bounds
    wanted = ["box"] * boxes + ["table"] * tables + ["cylinder"] * cylinders
    for kind in wanted:
        for _ in range(TRIES):
            x, y = float(rng.uniform(x0 + 0.5, x1 - 0.5)), float(rng.uniform(y0 + 0.5, y1 - 0.5))
            if kind == "box":
                trial = changed(world, boxes=[*world.boxes, _box(rng, x, y)])
            elif kind == "table":
                yaw = float(rng.choice([0.0, 0.5 * math.pi]))
                length, width = float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.7, 0.9))
                table = Table(x=x, y=y, yaw_rad=yaw, length=length, width=width, material="wood")
                trial = changed(world, tables=[*world.tables, table])
            else:
                radius, height = float(rng.uniform(0.15, 0.3)), float(rng.uniform(0.5, 1.3))
                material = ["print0", "print2", "brick", "grey"][int(rng.integers(4))]
                pillar = Cylinder(x=x, y=y, radius=radius, height=height, material=material)
                trial = changed(world, cylinders=[*world.cylinders, pillar])
            clear = math.hypot(x - world.start.x, y - world.start.y) > 1.0
            if clear and not _touching(trial) and is_connected(trial):
                world = trial
                break
    return world
