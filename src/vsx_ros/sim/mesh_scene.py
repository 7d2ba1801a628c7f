"""A world of triangles prepared for the z-buffer: packed textures with their mip levels, and baked light."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array
from vsx_ros.errors import ConfigError
from vsx_ros.kernels.sim.mesh_light import bake, fill_cells, smooth
from vsx_ros.kernels.sim.mesh_scene import MIP_LEVELS, MeshScene
from vsx_ros.sim.gazebo.assemble import Seen
from vsx_ros.sim.gazebo.elements import Lamp
from vsx_ros.sim.gazebo.surfaces import Picture, Pixels, Surface
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.scene import GREY

MAX_TEXELS = 2**27  # a house has a third of it; 4 bytes each
MOST_NODES = 300_000  # of the light's lattice
LEAST_STEP_M, ABOVE_M = 0.12, 6.0  # between its nodes; how high it reaches above the floor
SKY_RAYS = 32
SMOOTHINGS = 3
REACH_M = 2.0  # within which surfaces darken each other
USUAL_LIGHT = 1.2  # median irradiance that the lamps are scaled to: the world's own values suit no camera
_HOLE_PX = 512  # side of the map of a picture's holes, at most
_KINDS = {"point": 0.0, "spot": 1.0, "directional": 2.0}


def compile_mesh(world: MeshWorld) -> MeshScene:
    """Pack the textures and bake the light; takes a second. Raises ConfigError for a world whose textures do not fit
    into memory."""
    seen = world.parts.seen
    pictures = list(dict.fromkeys(s.picture for s in seen.surfaces if s.picture is not None))
    needed = sum(_texels(picture) for picture in pictures)
    if needed > MAX_TEXELS:
        raise ConfigError(
            f"world {world.name}: its {len(pictures)} textures have {needed} texels, at most {MAX_TEXELS} can be "
            "drawn; leave some out"
        )
    levels, texels = _packed(pictures)
    rows = {picture: row for row, picture in enumerate(pictures)}
    holes, hole_places = _holes(seen.surfaces)
    light, frame = _baked(world)
    return MeshScene(
        corners=seen.corners.reshape(-1, 9),
        uv=seen.uv.reshape(-1, 6),
        kinds=seen.kinds,
        chunks=seen.starts.astype(np.int32),
        spheres=_spheres(seen),
        colours=np.array([_reflectance(surface) for surface in seen.surfaces], np.float32),
        pictures=np.array([_place(s.picture, rows) for s in seen.surfaces], np.int32),
        levels=levels,
        texels=texels,
        holes=holes,
        hole_places=hole_places,
        light=light,
        light_frame=frame,
        sky=USUAL_LIGHT * world.sky,
    )


def _reflectance(surface: Surface) -> list[float]:
    """Linear r, g, b and grey of its colour."""
    linear = np.square(surface.colour)
    return [*linear.tolist(), float(linear @ GREY)]


def _logs(pixels: NDArray[np.uint8]) -> tuple[int, int]:
    """Binary logarithms of width and height."""
    return pixels.shape[1].bit_length() - 1, pixels.shape[0].bit_length() - 1


def _place(picture: Picture | None, rows: dict[Picture, int]) -> tuple[int, int, int]:
    return (-1, 0, 0) if picture is None else (rows[picture], *_logs(picture.pixels))


def _spheres(seen: Seen) -> FloatArray:
    """(K, 4) centre and radius around each group of triangles."""
    spheres = np.zeros((len(seen.starts) - 1, 4))
    for k, (a, b) in enumerate(zip(seen.starts[:-1], seen.starts[1:])):
        points = seen.corners[a:b].reshape(-1, 3).astype(float)
        if len(points):
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            spheres[k] = *middle, np.linalg.norm(points - middle, axis=1).max()
    return spheres


def _with_grey(pixels: Pixels) -> Pixels:
    """The picture with its grey value in place of alpha: the root of the mean of squares, as reflectance is stored."""
    squares = np.arange(256, dtype=np.uint32) ** 2
    weights = np.rint(GREY / GREY.sum() * 1024).astype(np.uint32)
    roots = np.rint(np.sqrt(np.arange(255**2 + 64))).astype(np.uint8)
    packed = pixels.copy()
    for rows in np.array_split(np.arange(len(pixels)), max(1, len(pixels) // 256)):  # bounds the memory
        total = sum((weights[i] * squares)[pixels[rows[0] : rows[-1] + 1, :, i]] for i in range(3))
        packed[rows[0] : rows[-1] + 1, :, 3] = roots[total >> 10]
    return packed


def _packed(pictures: list[Picture]) -> tuple[Int32Array, NDArray[np.uint32]]:
    """The mip levels of all pictures one after another, and where each begins (P, 12)."""
    begins, at = np.zeros((max(len(pictures), 1), MIP_LEVELS), np.int32), 0
    texels = np.zeros(1 + sum(_texels(picture) for picture in pictures), np.uint32)
    for row, picture in enumerate(pictures):
        level = _with_grey(picture.pixels)
        for k in range(MIP_LEVELS):
            begins[row, k:] = at
            texels[at : at + level[..., 0].size] = level.reshape(-1, 4).view(np.uint32).ravel()
            at += level[..., 0].size
            if level.shape[:2] == (1, 1):
                break
            size = max(level.shape[1] // 2, 1), max(level.shape[0] // 2, 1)
            level = np.ascontiguousarray(cv2.resize(level, size, interpolation=cv2.INTER_AREA)).reshape(*size[::-1], 4)
    return begins, texels


def _texels(picture: Picture) -> int:
    """The number of texels of a picture with its mip levels."""
    width, height = picture.pixels.shape[1], picture.pixels.shape[0]
    return sum(max(width >> k, 1) * max(height >> k, 1) for k in range(max(width, height).bit_length()))


def _holes(surfaces: list[Surface]) -> tuple[NDArray[np.uint8], Int32Array]:
    """Alpha of the pictures with holes, and per surface where it begins and its size's logarithms."""
    places, parts, at = np.full((len(surfaces), 3), -1, np.int32), [np.zeros(1, np.uint8)], 1
    known: dict[Picture, tuple[int, int, int]] = {}
    for i, surface in enumerate(surfaces):
        picture = surface.picture
        if picture is None or not picture.has_holes:
            continue
        if picture not in known:
            alpha = picture.pixels[..., 3]
            size = min(alpha.shape[1], _HOLE_PX), min(alpha.shape[0], _HOLE_PX)
            alpha = np.ascontiguousarray(cv2.resize(alpha, size, interpolation=cv2.INTER_AREA))
            known[picture] = (at, *_logs(alpha))
            parts.append(alpha.ravel())
            at += alpha.size
        places[i] = known[picture]
    return np.concatenate(parts), places


def _lattice(world: MeshWorld) -> tuple[FloatArray, tuple[int, int, int]]:
    """Origin and spacing (4,) and shape (Z, Y, X) of the light's nodes: from below the floor to above the ceiling."""
    x0, y0, x1, y1 = world.bounds
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


def _baked(world: MeshWorld) -> tuple[Float32Array, FloatArray]:
    """Irradiance (Z, Y, X, 6) at the nodes of a lattice, and its frame; scaled so that rooms are lit as rooms are."""
    frame, shape = _lattice(world)
    solid: BoolArray = np.zeros(shape, np.bool_)
    fill_cells(world.parts.seen.corners.reshape(-1, 9), frame, solid)
    lamps = np.array([_lamp_row(lamp) for lamp in world.lamps], float).reshape(-1, 13)
    light = np.zeros((*shape, 6), np.float32)
    bake(solid, frame, _even_directions(SKY_RAYS), REACH_M / frame[3], world.ambient, lamps, light)
    free = ~solid
    known = free
    for _ in range(SMOOTHINGS):  # the edges of shadows; and into walls, as far as surfaces look the light up
        known, light = smooth(known, light)
    heights = frame[2] + frame[3] * np.arange(shape[0])
    low = (heights > 0.1) & (heights < 1.5)
    usual = float(np.median(light[low][free[low]])) if free[low].any() else 0.0
    light *= np.float32(USUAL_LIGHT / max(usual, 1e-3))
    return light, frame
