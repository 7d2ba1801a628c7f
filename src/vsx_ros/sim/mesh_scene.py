"""A world of triangles prepared for the z-buffer, with baked light."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels.sim.mesh_light import bake, fill_cells, smooth
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.sim.gazebo.assemble import Seen, with_more
from vsx_ros.sim.gazebo.elements import Lamp
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.scene import GREY

MOST_NODES = 300_000  # of the light's lattice
LEAST_STEP_M, ABOVE_M = 0.12, 6.0  # between its nodes; how high it reaches above the floor
SKY_RAYS = 32
SMOOTHINGS = 3
REACH_M = 2.0  # within which surfaces darken each other
USUAL_LIGHT = 1.2  # median irradiance that the lamps are scaled to: the world's own values suit no camera
_KINDS = {"point": 0.0, "spot": 1.0, "directional": 2.0}


def compile_mesh(world: MeshWorld, more: Seen | None = None) -> MeshScene:
    """Bake the light; takes half a second. more: what is drawn, too, but throws no shadow, because it will move."""
    seen = world.parts.seen if more is None else with_more(world.parts.seen, more)
    textures, linear = seen.textures, np.square(seen.colours)
    logs = np.vstack([textures.logs, np.zeros((1, 2), np.int32)])[seen.pictures]  # the last row: without a picture
    holes, hole_places = _holes(seen)
    lamps = np.array([_lamp_row(lamp) for lamp in world.lamps], float).reshape(-1, 13)
    light, frame, usual = _baked(world, lamps)
    lamps[:, 7] *= usual
    return MeshScene(
        corners=seen.corners.reshape(-1, 9),
        uv=seen.uv.reshape(-1, 6),
        kinds=seen.kinds,
        chunks=seen.starts.astype(np.int32),
        spheres=spheres_around(seen.corners, seen.starts),
        colours=np.column_stack([linear, linear @ GREY]).astype(np.float32),
        pictures=np.column_stack([seen.pictures, *logs.T]).astype(np.int32),
        levels=textures.levels,
        texels=textures.texels,
        holes=holes,
        hole_places=hole_places,
        light=light,
        light_frame=frame,
        sky=USUAL_LIGHT * world.sky,
        lamps=lamps,
        ambient=usual * world.ambient,
    )


def spheres_around(corners: Float32Array, starts: IntArray) -> FloatArray:
    """(K, 4) centre and radius around each group of triangles (T, 3, 3), which begin at starts (K + 1,)."""
    spheres = np.zeros((len(starts) - 1, 4))
    for k, (a, b) in enumerate(zip(starts[:-1], starts[1:])):
        points = corners[a:b].reshape(-1, 3).astype(float)
        if len(points):
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            spheres[k] = *middle, np.linalg.norm(points - middle, axis=1).max()
    return spheres


def _holes(seen: Seen) -> tuple[NDArray[np.uint8], Int32Array]:
    """Alpha of the pictures with holes, and per surface where it begins and its size's logarithms."""
    places, parts, at = np.full((len(seen.textures.alphas) + 1, 3), -1, np.int32), [np.zeros(1, np.uint8)], 1
    for row, alpha in enumerate(seen.textures.alphas):
        if alpha is not None:
            places[row] = at, alpha.shape[1].bit_length() - 1, alpha.shape[0].bit_length() - 1
            parts.append(alpha.ravel())
            at += alpha.size
    return np.concatenate(parts), places[seen.pictures]


def _lattice(world: MeshWorld) -> tuple[FloatArray, tuple[int, int, int]]:
    """Origin and spacing (4,) and shape (Z, Y, X) of the light's nodes: from below the floor to above the ceiling."""
    x0, y0, x1, y1 = world.obstacle_bounds
    tops = world.parts.seen.corners[..., 2]
    top = float(np.clip(np.percentile(tops, 99.0) if tops.size else 2.0, 1.5, ABOVE_M)) + 0.3
    size = np.array([x1 - x0, y1 - y0, top + 0.3])
    step = max(LEAST_STEP_M, float((np.prod(size) / MOST_NODES) ** (1.0 / 3.0)))
    nx, ny, nz = (max(2, math.ceil(length / step) + 1) for length in size)
    return np.array([x0, y0, -0.3, step]), (nz, ny, nx)


def _lamp_row(lamp: Lamp) -> list[float]:
    kind = _KINDS.get(lamp.kind, 0.0)
    fade = lamp.attenuation
    return [kind, *lamp.position, *lamp.direction, lamp.strength, *fade, math.cos(min(lamp.half_angle_rad, math.pi))]


def _even_directions(n: int) -> FloatArray:
    """(n, 3) unit vectors of a spiral over the sphere."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.arange(n) * math.pi * (3.0 - math.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def _baked(world: MeshWorld, lamps: FloatArray) -> tuple[Float32Array, FloatArray, float]:
    """Irradiance (Z, Y, X, 6) at the nodes of a lattice, its frame, and the factor that lights rooms as rooms are."""
    frame, shape = _lattice(world)
    solid: BoolArray = np.zeros(shape, np.bool_)
    fill_cells(world.parts.seen.corners.reshape(-1, 9), frame, solid)
    light = np.zeros((*shape, 6), np.float32)
    bake(solid, frame, _even_directions(SKY_RAYS), REACH_M / frame[3], world.ambient, lamps, light)
    free = ~solid
    known = free
    for _ in range(SMOOTHINGS):  # the edges of shadows; and into walls, as far as surfaces look the light up
        known, light = smooth(known, light)
    heights = frame[2] + frame[3] * np.arange(shape[0])
    low = (heights > 0.1) & (heights < 1.5)
    usual = float(np.median(light[low][free[low]])) if free[low].any() else 0.0
    factor = USUAL_LIGHT / max(usual, 1e-3)
    light *= np.float32(factor)
    return light, frame, factor
