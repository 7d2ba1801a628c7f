"""A world prepared for the ray caster: quads, packed textures and light maps as plain arrays."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import FloatArray, Int32Array, Points2
from vsx_ros.errors import ConfigError
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.sim.textures import packed_levels, texture, texture_size
from vsx_ros.sim.world import Material, Prism, World, prisms

SKIRTING_HEIGHT = 0.08  # m
LIGHT_SPACING = 0.25  # m between the nodes of a light map
OUTSIDE_LIGHT = 8.0  # irradiance of a view through a window; of a lit wall about 1
MAX_BYTES = 2**28  # of textures and light maps: a building of 40 x 25 m needs a third of it
GREY = np.array([0.299, 0.587, 0.114])  # of RGB, ITU-R BT.601


class Quad(NamedTuple):
    """corner + u edge_u + v edge_v [m], 0 <= u, v <= 1. Visible only from the side from which edge_u x edge_v points
    away. along: start of the quad on the texture [m], so that neighbouring faces continue each other. fitted: the
    texture stretches over the quad instead."""

    corner: FloatArray
    edge_u: FloatArray
    edge_v: FloatArray
    material: str
    along: float = 0.0
    fitted: bool = False


def _side(a: Points2, b: Points2, z_min: float, z_max: float, material: str, along: float) -> Quad:
    """Upright quad over the floor segment a -> b, seen from its right; texture upright (v down)."""
    corner = np.array([a[0], a[1], z_max])
    edge_u, edge_v = np.array([b[0] - a[0], b[1] - a[1], 0.0]), np.array([0.0, 0.0, z_min - z_max])
    return Quad(corner, edge_u, edge_v, material, along=along)


def _lid(footprint: Points2, z: float, material: str, facing_up: bool) -> list[Quad]:
    """Quads that cover a convex footprint: the parallelogram itself, or slices of it."""
    pieces = [footprint]
    if len(footprint) != 4:
        # Slices between mirrored pairs of corners; each trapezoid becomes the parallelogram of the same area.
        pieces = []
        for i in range(len(footprint) // 2 - 1):
            a, b, c, d = footprint[i], footprint[-1 - i], footprint[i + 1], footprint[-2 - i]
            half = 0.25 * (c + d - a - b)
            near, far = 0.5 * (a + c), 0.5 * (b + d)
            pieces.append(np.array([near - half, near + half, far + half, far - half]))
    flip = -1.0 if facing_up else 1.0
    quads = []
    for piece in pieces:
        u, v = piece[1] - piece[0], piece[3] - piece[0]
        corner = np.array([piece[0][0], piece[0][1], z])
        edge_u, edge_v = np.array([u[0], u[1], 0.0]), np.array([v[0], v[1], 0.0])
        if np.cross(edge_u, edge_v)[2] * flip < 0:
            edge_u, edge_v = edge_v, edge_u
        quads.append(Quad(corner, edge_u, edge_v, material))
    return quads


def solid_quads(solid: Prism, *, top: bool, bottom: bool) -> list[Quad]:
    """The sides of a solid, and its lids if wanted."""
    ring, surfaces = solid.footprint, []
    along = 0.7 * float(ring[0].sum())
    for a, b in zip(ring, np.roll(ring, -1, axis=0)):
        surfaces.append(_side(a, b, solid.z_min, solid.z_max, solid.material, along))
        along += float(np.hypot(*(b - a)))
    if top:
        surfaces += _lid(ring, solid.z_max, solid.material, True)
    if bottom:
        surfaces += _lid(ring, solid.z_min, solid.material, False)
    return surfaces


def quads(world: World) -> list[Quad]:
    """Every surface of the world, in the order of the file: floor, ceiling, outlines, solids, posters."""
    x0, y0, x1, y1 = world.bounds
    ground = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    surfaces = _lid(ground, 0.0, world.floor, True) + _lid(ground, world.ceiling_height, world.ceiling, False)
    for outline in world.outlines:
        loop = np.asarray(outline.points, float)
        for a, b, material in zip(np.roll(loop, -1, axis=0), loop, outline.side_materials):
            surfaces.append(_side(a, b, 0.0, outline.height, material, float(a[0] + a[1])))
            if outline.skirting is not None:
                along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
                inward = 0.01 * np.array([along[1], -along[0]])
                surfaces.append(_side(a + inward, b + inward, 0.0, SKIRTING_HEIGHT, outline.skirting, 0.0))
    for solid in prisms(world):
        surfaces += solid_quads(solid, top=solid.z_max < world.ceiling_height - 0.01, bottom=solid.z_min > 0.01)
    for poster in world.posters:
        c, s = math.cos(poster.yaw_rad), math.sin(poster.yaw_rad)
        edge_u = np.array([-s, c, 0.0]) * poster.width
        edge_v = np.array([0.0, 0.0, -poster.height])
        middle = np.array([poster.x + 0.004 * c, poster.y + 0.004 * s, poster.z])
        surfaces.append(Quad(middle - 0.5 * (edge_u + edge_v), edge_u, edge_v, poster.material, fitted=True))
    return surfaces


def _nodes(quad: Quad) -> tuple[int, int]:
    """Numbers of nodes of the quad's light map along its edges."""
    lengths = (float(np.linalg.norm(edge)) for edge in (quad.edge_u, quad.edge_v))
    along_u, along_v = (min(max(math.ceil(length / LIGHT_SPACING) + 1, 2), 64) for length in lengths)
    return along_u, along_v


def irradiance(world: World, points: FloatArray, facing: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """(...) irradiance at points (..., 3): ambient plus every lamp by cosine and inverse square law. facing: components
    of vectors (..., 3) along the surfaces' normals."""
    total = np.full(points.shape[:-1], world.ambient)
    for lamp in world.lights:
        to_lamp = np.array([lamp.x, lamp.y, lamp.z]) - points
        distance2 = (to_lamp**2).sum(axis=-1) + 0.25
        cosine = np.maximum(facing(to_lamp) / np.sqrt(distance2), 0.0)
        total += lamp.strength * cosine / distance2
    return total


def _light_map(quad: Quad, world: World, nu: int, nv: int) -> FloatArray:
    """(nv, nu) irradiance at the nodes."""
    u, v = np.meshgrid(np.linspace(0, 1, nu), np.linspace(0, 1, nv))
    points = quad.corner + u[..., None] * quad.edge_u + v[..., None] * quad.edge_v
    normal = np.cross(quad.edge_v, quad.edge_u)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
    total = irradiance(world, points, lambda vectors: vectors @ normal)
    # A soft contact shadow: upright surfaces are darker near the floor.
    if abs(normal[2]) < 0.5:
        total *= 1.0 - 0.25 * np.exp(-points[..., 2] / 0.3)
    return total


def _pack_light(light: FloatArray, scale: float) -> Int32Array:
    """Nodes as bytes, packed 2x2 like texels but clamped at the border; flat int32."""
    t = np.clip(np.rint(light * (255.0 / scale)), 0, 255).astype(np.uint32)
    t = np.pad(t, ((0, 1), (0, 1)), mode="edge")
    packed = t[:-1, :-1] | t[:-1, 1:] << 8 | t[1:, :-1] << 16 | t[1:, 1:] << 24
    return np.ascontiguousarray(packed).ravel().view(np.int32)


def _check_size(world: World, surfaces: list[Quad], names: list[str]) -> None:
    needed = sum(16 * texture_size(world.materials[name]) ** 2 // 3 for name in names)
    needed += sum(4 * math.prod(_nodes(quad)) for quad in surfaces)
    if needed > MAX_BYTES:
        raise ConfigError(
            f"world {world.generator.name}: its {len(names)} textures and {len(surfaces)} lit surfaces need {needed} "
            f"bytes, at most {MAX_BYTES} can be drawn; leave some out"
        )


def compile_scene(world: World, movers: Sequence[Quad] = (), materials: Mapping[str, Material] | None = None) -> Scene:
    """Draw the textures, compute the light maps, lay out the quads. Takes about a second. movers: quads in frames of
    their own, which come last, in even light of 1; materials: theirs. Raises ConfigError for a world whose textures and
    lights need more than ``MAX_BYTES``."""
    world = replace(world, materials={**world.materials, **(materials or {})})
    still = quads(world)
    surfaces = [*still, *movers]
    names = sorted({quad.material for quad in surfaces})
    _check_size(world, surfaces, names)
    levels = [packed_levels(texture(world.materials[name])) for name in names]
    sizes = [int(round(math.log2(math.isqrt((3 * len(level) + 1) // 4)))) for level in levels]
    starts = np.concatenate([[0], np.cumsum([len(level) for level in levels])])
    n = len(surfaces)
    surface, place = np.zeros((n, 5), np.float32), np.zeros((n, 5), np.int32)
    tints = np.zeros((n, 4), np.float32)
    maps, at = [], 0
    for i, quad in enumerate(surfaces):
        material, k = world.materials[quad.material], names.index(quad.material)
        lengths = [float(np.linalg.norm(quad.edge_u)), float(np.linalg.norm(quad.edge_v))]
        nodes = _nodes(quad)
        light = np.ones(nodes[::-1])
        if material.kind == "outside":
            light *= OUTSIDE_LIGHT
        elif i < len(still):
            light = _light_map(quad, world, nodes[0], nodes[1])
        scale = max(float(light.max()), 1e-6)
        maps.append(_pack_light(light, scale))
        side = float(2 ** sizes[k])
        texels = [side, side] if quad.fitted else [length / material.texel_m for length in lengths]
        offset = [0.0, 0.0] if quad.fitted else [quad.along / material.texel_m % side, 0.0]
        surface[i] = [*texels, *offset, scale / 255.0 / 255.0]
        place[i] = [starts[k], sizes[k], at, nodes[0], nodes[1]]
        tints[i] = *material.tint, np.asarray(material.tint, float) @ GREY
        at += len(maps[-1])
    P, U, V = (np.array(part) for part in list(zip(*surfaces))[:3])
    tex, light = np.concatenate(levels), np.concatenate(maps)
    return Scene(P=P, U=U, V=V, surfaces=surface, places=place, tints=tints, tex=tex, light=light)
