"""The light on a quad: irradiance at a lattice of nodes, by lamps and by sunlight through windows, without shadows of
things; and its packing for the ray caster."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Int32Array
from vsx_ros.sim.world import Light

LIGHT_SPACING_M = 0.25  # between the nodes of a light map
LONGEST_M = 16.0  # side of a quad whose nodes are so near each other; on longer ones they are farther apart
SOFT_M = 0.05  # width of the edge of a patch of sunlight


class Nodes(NamedTuple):
    """points (..., 3) [m] of surfaces with this normal (3,), or with one at each point (..., 3)."""

    points: FloatArray
    normal: FloatArray

    def facing(self, vectors: FloatArray) -> FloatArray:
        """(...) components of vectors (..., 3) along the normals."""
        return vectors @ self.normal if self.normal.ndim == 1 else (vectors * self.normal).sum(axis=-1)


class Window(NamedTuple):
    """An opening: middle (3,) [m], unit vectors along the wall and into the room (3,), size (width, height) [m]."""

    middle: FloatArray
    along: FloatArray
    inwards: FloatArray
    size: tuple[float, float]


def node_counts(edge_u: FloatArray, edge_v: FloatArray, spacing_m: float) -> tuple[int, int]:
    """Numbers of nodes of a quad's light map along its edges."""
    lengths, most = (float(np.linalg.norm(edge)) for edge in (edge_u, edge_v)), round(LONGEST_M / spacing_m)
    along_u, along_v = (min(max(math.ceil(length / spacing_m) + 1, 2), most) for length in lengths)
    return along_u, along_v


def nodes_of(corner: FloatArray, edge_u: FloatArray, edge_v: FloatArray, counts: tuple[int, int]) -> Nodes:
    """The (nv, nu) nodes of a quad. counts: along u and along v."""
    u, v = np.meshgrid(np.linspace(0, 1, counts[0]), np.linspace(0, 1, counts[1]))
    points = corner + u[..., None] * edge_u + v[..., None] * edge_v
    normal = np.cross(edge_v, edge_u)
    return Nodes(points, normal / max(float(np.linalg.norm(normal)), 1e-12))


def irradiance(nodes: Nodes, lamps: Sequence[Light], ambient: float) -> FloatArray:
    """(...) at the nodes: ambient plus every lamp by cosine and inverse square law."""
    points = nodes.points
    total = np.full(points.shape[:-1], ambient)
    for lamp in lamps:
        to_lamp = np.array([lamp.x, lamp.y, lamp.z]) - points
        distance2 = (to_lamp**2).sum(axis=-1) + 0.25
        cosine = np.maximum(nodes.facing(to_lamp) / np.sqrt(distance2), 0.0)
        total += lamp.strength * cosine / distance2
    # A soft contact shadow: upright surfaces are darker near the floor.
    upright = np.abs(nodes.normal[..., 2]) < 0.5
    return np.where(upright, total * (1.0 - 0.25 * np.exp(-points[..., 2] / 0.3)), total)


def sunlight(nodes: Nodes, windows: Sequence[Window], beam: FloatArray) -> FloatArray:
    """(...) share of sunlight that travels along beam (3,) and falls through one of the windows onto the nodes."""
    points = nodes.points
    most = np.zeros(points.shape[:-1])
    cosine = np.maximum(-nodes.facing(beam), 0.0)
    for window in windows if cosine.any() else ():
        entering = float(beam @ window.inwards)
        if entering <= 1e-3:
            continue
        behind = (points - window.middle) @ window.inwards
        through = points - window.middle - (behind / entering)[..., None] * beam
        aside = 0.5 * window.size[0] - np.abs(through @ window.along)
        inside = np.minimum(aside, 0.5 * window.size[1] - np.abs(through[..., 2]))
        most = np.maximum(most, np.where(behind > 0.0, np.clip(inside / SOFT_M + 0.5, 0.0, 1.0), 0.0))
    return np.asarray(cosine * most)


class Lights(NamedTuple):
    """The light of a moment. ambient: irradiance from everywhere; sun: irradiance, head on, of sunlight that travels
    along beam (3,) and falls through the windows."""

    lamps: Sequence[Light] = ()
    ambient: float = 0.0
    sun: float = 0.0
    beam: FloatArray = np.zeros(3)
    windows: Sequence[Window] = ()

    def on(self, nodes: Nodes) -> FloatArray:
        """(...) irradiance at the nodes."""
        light = irradiance(nodes, self.lamps, self.ambient)
        return light + self.sun * sunlight(nodes, self.windows, self.beam) if self.sun > 0.0 else light


def pack_light(light: FloatArray, scale: float) -> Int32Array:
    """Nodes as bytes, packed 2x2 like texels but clamped at the border; flat int32."""
    t = np.clip(np.rint(light * (255.0 / scale)), 0, 255).astype(np.uint32)
    t = np.pad(t, ((0, 1), (0, 1)), mode="edge")
    packed = t[:-1, :-1] | t[:-1, 1:] << 8 | t[1:, :-1] << 16 | t[1:, 1:] << 24
    return np.ascontiguousarray(packed).ravel().view(np.int32)
