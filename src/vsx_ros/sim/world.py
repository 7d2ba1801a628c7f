"""The emulated building: the contents of a world file, and its solids. Metres, world frame, floor at z = 0."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.lighting import Lighting

Positive = Annotated[float, Meta(gt=0, le=1000)]
Metres = Annotated[float, Meta(ge=-10000, le=10000)]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Point = tuple[Metres, Metres]
Tint = tuple[Ratio, Ratio, Ratio]
TextureKind = Literal["plain", "paint", "wood", "brick", "carpet", "tiles", "wallpaper", "poster", "print", "panels",
                      "mirror", "glass", "outside"]  # fmt: skip


class _Part(Struct, frozen=True, forbid_unknown_fields=True):
    """Common base: immutable, unknown names are refused."""


class Material(_Part, frozen=True, kw_only=True):
    """A procedural surface: kind and seed fix its pattern; brightness its mean; contrast scales the pattern. texel_m:
    metres per texel of a repeating texture (posters stretch over their frame). tint: r, g, b reflectance."""

    kind: TextureKind
    seed: Annotated[int, Meta(ge=0)] = 0
    brightness: Ratio = 0.6
    contrast: Annotated[float, Meta(ge=0, le=2)] = 1.0
    texel_m: Annotated[float, Meta(ge=0.0005, le=0.1)] = 0.004
    tint: Tint = (1.0, 1.0, 1.0)


class Outline(_Part, frozen=True, kw_only=True):
    """A closed polygon with free space to the left of its direction and solid building to its right. material: one name
    for all sides, or one per side."""

    points: Annotated[list[Point], Meta(min_length=3)]
    height: Positive
    material: str | list[str]
    skirting: str | None = None

    @property
    def side_materials(self) -> list[str]:
        """The material of each side, the first from points[0] to points[1]."""
        return [self.material] * len(self.points) if isinstance(self.material, str) else self.material


class Wall(_Part, frozen=True, kw_only=True):
    """A free-standing wall along a polyline."""

    points: Annotated[list[Point], Meta(min_length=2)]
    thickness: Positive
    height: Positive
    material: str
    skirting: str | None = None


class _Placed(_Part, frozen=True, kw_only=True):
    """Anything at a place x, y."""

    x: Metres
    y: Metres


class Box(_Placed, frozen=True, kw_only=True):
    """A cuboid on the floor (or at base_z), centred at x, y, turned by yaw_rad."""

    yaw_rad: float = 0.0
    length: Positive
    width: Positive
    height: Positive
    base_z: Annotated[float, Meta(ge=0, le=100)] = 0.0
    material: str


class Table(_Placed, frozen=True, kw_only=True):
    """A slab on four square legs."""

    yaw_rad: float = 0.0
    length: Positive
    width: Positive
    height: Positive = 0.74
    thickness: Positive = 0.04
    leg: Positive = 0.05
    material: str


class Cylinder(_Placed, frozen=True, kw_only=True):
    """A round pillar or bin, a prism of 16 faces."""

    radius: Positive
    height: Positive
    material: str


class Poster(_Placed, frozen=True, kw_only=True):
    """A picture centred at x, y, z, facing the direction yaw_rad."""

    z: Metres
    yaw_rad: float
    width: Positive
    height: Positive
    material: str


class Light(_Placed, frozen=True, kw_only=True):
    """A lamp at x, y, z; strength: irradiance at 1 m, head on, in units of full-scale reflectance."""

    z: Metres
    strength: Annotated[float, Meta(ge=0, le=100)]


class Origin(_Part, frozen=True, kw_only=True):
    """The origin of a world."""

    name: str
    seed: int


class Start(_Placed, frozen=True, kw_only=True):
    """Where the robot starts."""

    theta_rad: float


class World(_Part, frozen=True, kw_only=True):
    """A whole building, as in its ``world_file``. lighting: None for steady lamps; hard: ``HARD_THINGS`` by name."""

    version: Literal[1] = 1
    generator: Origin
    start: Start
    ceiling_height: Positive
    floor: str
    ceiling: str
    ambient: Annotated[float, Meta(ge=0, le=10)] = 0.35
    materials: dict[str, Material]
    outlines: Annotated[list[Outline], Meta(min_length=1)]
    walls: list[Wall] = []
    boxes: list[Box] = []
    tables: list[Table] = []
    cylinders: list[Cylinder] = []
    posters: list[Poster] = []
    lights: list[Light] = []
    lighting: Lighting | None = None
    hard: dict[str, float] = {}

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of the outlines [m]."""
        points = np.concatenate([np.asarray(outline.points) for outline in self.outlines])
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def start_pose(self) -> SE2:
        """T_world_base at the beginning."""
        return SE2(self.start.x, self.start.y, self.start.theta_rad)

    @property
    def name(self) -> str:
        """What made it."""
        return self.generator.name

    @property
    def sights(self) -> list[Point]:
        """Places of pictures and of printed boxes, good to look at."""
        printed = [(box.x, box.y) for box in self.boxes if box.material.startswith("print")]
        return [(poster.x, poster.y) for poster in self.posters] + printed

    def starting_at(self, start: Start) -> "World":
        """The same world with another start."""
        return replace(self, start=start)

    def plan(self, z_min: float, z_max: float) -> Iterator[tuple[Points2, bool]]:
        """Polygons (N, 2), and whether they are solid between the heights [m]; later ones cover earlier ones."""
        for loop in sorted((np.asarray(o.points, float) for o in self.outlines), key=signed_area, reverse=True):
            yield loop, signed_area(loop) <= 0
        for prism in prisms(self):
            if prism.z_min < z_max and prism.z_max > z_min:
                yield prism.footprint, True

    def obstacle_segments(self, z_min: float, z_max: float) -> FloatArray:
        """(N, 4) borders of all solids between the heights: x0, y0, x1, y1 [m], solid to their left."""
        loops = [np.asarray(outline.points, float)[::-1] for outline in self.outlines if outline.height > z_min]
        loops += [p.footprint for p in prisms(self) if p.z_min < z_max and p.z_max > z_min]
        return np.concatenate([np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in loops])


def signed_area(loop: Points2) -> float:
    """The area of a polygon (N, 2) [m2], positive if it runs counter-clockwise."""
    x, y = loop[:, 0], loop[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


class Prism(NamedTuple):
    """A solid with a convex footprint (N, 2), counter-clockwise, from z_min to z_max [m]."""

    footprint: Points2
    z_min: float
    z_max: float
    material: str


def rectangle(x: float, y: float, yaw: float, length: float, width: float) -> Points2:
    """(4, 2) corners, counter-clockwise, of a rectangle centred at x, y [m] turned by yaw [rad]."""
    corners = 0.5 * np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    return SE2(x, y, yaw) @ corners


def _wall_prisms(wall: Wall) -> list[Prism]:
    prisms = []
    for (ax, ay), (bx, by) in zip(wall.points[:-1], wall.points[1:]):
        middle = 0.5 * (ax + bx), 0.5 * (ay + by), math.atan2(by - ay, bx - ax)
        length = math.hypot(bx - ax, by - ay)
        prisms.append(Prism(rectangle(*middle, length, wall.thickness), 0.0, wall.height, wall.material))
        if wall.skirting is not None:
            prisms.append(Prism(rectangle(*middle, length + 0.02, wall.thickness + 0.02), 0.0, 0.08, wall.skirting))
    return prisms


def _table_prisms(table: Table) -> list[Prism]:
    top = table.height - table.thickness
    slab = rectangle(table.x, table.y, table.yaw_rad, table.length, table.width)
    prisms = [Prism(slab, top, table.height, table.material)]
    place = SE2(table.x, table.y, table.yaw_rad)
    for sx, sy in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
        x, y = sx * (table.length - table.leg - 0.04), sy * (table.width - table.leg - 0.04)
        prisms.append(Prism(place @ rectangle(x, y, 0.0, table.leg, table.leg), 0.0, top, table.material))
    return prisms


def prisms(world: World) -> list[Prism]:
    """Every free-standing solid of the world, in the order of the file."""
    solids = [prism for wall in world.walls for prism in _wall_prisms(wall)]
    for box in world.boxes:
        footprint = rectangle(box.x, box.y, box.yaw_rad, box.length, box.width)
        solids.append(Prism(footprint, box.base_z, box.base_z + box.height, box.material))
    solids += [prism for table in world.tables for prism in _table_prisms(table)]
    angles = (np.arange(16) + 0.5) * (2.0 * math.pi / 16)
    for cylinder in world.cylinders:
        ring = np.column_stack([np.cos(angles), np.sin(angles)]) * cylinder.radius
        solids.append(Prism(ring + np.array([cylinder.x, cylinder.y]), 0.0, cylinder.height, cylinder.material))
    return solids
