"""Furniture: boxes, tables and pillars that leave every passage open."""

from __future__ import annotations

import math

import numpy as np

from vsx_ros.sim.placement import is_connected
from vsx_ros.sim.world import Box, Cylinder, Table, World, changed

Rng = np.random.Generator
TRIES = 30


def _box(rng: Rng, x: float, y: float) -> Box:
    length, width, height = (float(v) for v in rng.uniform([0.4, 0.4, 0.4], [1.2, 0.8, 1.4]))
    kinds = ["print0", "print1", "print2", "print3", "wood", "paint", "grey"]
    material = kinds[int(rng.choice(7, p=[0.16, 0.16, 0.16, 0.16, 0.12, 0.12, 0.12]))]
    yaw = float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0, math.pi)]))
    return Box(x=x, y=y, yaw_rad=yaw, length=length, width=width, height=height, material=material)


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
            if clear and is_connected(trial) and not _touching(trial):
                world = trial
                break
    return world
