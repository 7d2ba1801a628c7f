"""A scene as a path tracer takes it: triangles with textures, what they are made of, and lamps that have a size.

Light is in the units of ``Picture``: a white sheet under irradiance E has the value E, pi times its radiance."""

from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, IntArray, Points3
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.moving_mesh import MovingMesh
from vsx_ros.sim.reflectors import Reflector

AnyScene: TypeAlias = DrawnWorld | MeshScene | MovingMesh
PANEL_M = 0.6  # side of a lamp's panel
_DOWNWARDS = 2.0  # a panel sends as much light downwards as a point does, which by cosine is twice as much head on
_UNDER_CEILING_M = 0.5  # lamps that hang nearer to the ceiling are panels
_MIRROR_LEAST = 0.5  # share of light that a mirror reflects; less is gloss
_MEASURED_M = 2.0  # distance at which a lamp of a Gazebo world is as bright as it says
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # of a quad, in u and v
_FACES = np.array([[0, 2, 1], [0, 3, 2]])  # counter-clockwise as seen

Finish: TypeAlias = Literal["matt", "gloss", "mirror", "glass"]


class Surface(NamedTuple):
    """Triangles of one material: corners (N, 3) [m], uv (N, 2) with v down the picture, faces (F, 3). picture (H, W) or
    (H, W, 3) float32: reflectance, which repeats; alpha (H, W): 0 where there is a hole. share: of light from straight
    ahead that the finish reflects. glow: how often the picture's reflectance it shines by itself. both_sides: of a
    surface that is seen from behind, too."""

    corners: Points3
    uv: FloatArray
    faces: IntArray
    picture: Float32Array
    alpha: Float32Array | None = None
    finish: Finish = "matt"
    share: float = 0.0
    glow: float = 0.0
    both_sides: bool = False


class LitLamp(NamedTuple):
    """panel: hangs at place [m] and shines downwards; point; spot: shines along direction within cutoff_rad;
    directional. strength: irradiance at 1 m, head on; of a directional one, everywhere."""

    kind: Literal["panel", "point", "spot", "directional"]
    place: FloatArray
    direction: FloatArray
    strength: float
    cutoff_rad: float = 0.0


class Lighting(NamedTuple):
    """ambient: irradiance on everything, where no bounced light stands for it; sky: what is seen where nothing is."""

    lamps: list[LitLamp]
    ambient: float
    sky: float


def still_surfaces(scene: AnyScene) -> list[Surface]:
    """All but the movers."""
    if not isinstance(scene, DrawnWorld):
        return list(_meshes(scene.still if isinstance(scene, MovingMesh) else scene))
    count = len(scene.scene.P) - (0 if scene.movers is None else len(scene.movers.quads))
    return list(_quads(scene, np.arange(count), scene.scene.P, scene.scene.U, scene.scene.V))


def moving_surfaces(scene: DrawnWorld | MovingMesh, states: FloatArray | None) -> list[Surface]:
    """The movers, where they are at the middle of an image with these states (S, B, K)."""
    if isinstance(scene, MovingMesh):
        return [] if states is None else list(_meshes(scene.moved(states)))
    moved = scene.moved(states)
    if scene.movers is None or moved is None:
        return []
    s, b = moved.R.shape[0] // 2, moved.R.shape[1] // 2
    R, t = moved.R[s, b, scene.movers.part_of], moved.t[s, b, scene.movers.part_of]
    first = len(scene.scene.P) - len(R)
    P, U, V = scene.scene.P.copy(), scene.scene.U.copy(), scene.scene.V.copy()
    P[first:] = (R @ P[first:, :, None])[..., 0] + t
    U[first:], V[first:] = (R @ U[first:, :, None])[..., 0], (R @ V[first:, :, None])[..., 0]
    return list(_quads(scene, np.arange(first, len(P)), P, U, V))


def lighting_of(scene: AnyScene) -> Lighting:
    """The lamps that burn. In a generated world bounced light stands for its ambient light, if any lamp burns."""
    if not isinstance(scene, DrawnWorld):
        scene = scene.scene if isinstance(scene, MovingMesh) else scene
        return Lighting([_gazebo_lamp(row) for row in scene.lamps], scene.ambient, scene.sky)
    ceiling = float(scene.scene.P[1, 2])
    down, lamps = np.array([0.0, 0.0, -1.0]), []
    for lamp in scene.lights.lamps:
        if lamp.strength > 0.0:
            hangs = ceiling - _UNDER_CEILING_M < lamp.z < ceiling
            place = np.array([lamp.x, lamp.y, lamp.z])
            strength = lamp.strength * (_DOWNWARDS if hangs else 1.0)
            lamps.append(LitLamp("panel" if hangs else "point", place, down, strength))
    return Lighting(lamps, 0.0 if lamps else scene.lights.ambient, 0.0)


def _quads(world: DrawnWorld, numbers: IntArray, P: Points3, U: Points3, V: Points3) -> Iterator[Surface]:
    """Quads of one picture, tint and finish together."""
    scene, shiny = world.scene, {int(q): r for r in world.reflectors for q in r.quads}
    glowing = set(world.glowing.tolist())
    groups: dict[tuple[float, ...], list[int]] = {}
    for q in numbers.tolist():
        key = (*scene.places[q, :2].tolist(), *scene.tints[q, :3].tolist(), q if q in shiny else -1, q in glowing)
        groups.setdefault(key, []).append(q)
    for of_one in groups.values():
        q = of_one[0]
        begin, size = int(scene.places[q, 0]), 1 << int(scene.places[q, 1])
        grey = (scene.tex[begin : begin + size * size] & 255).reshape(size, size).astype(np.float32) / 255.0
        tint = scene.tints[q, :3]
        picture = grey * tint[0] if np.ptp(tint) == 0.0 else grey[..., None] * tint
        corners = P[of_one, None] + _CORNERS[:, :1] * U[of_one, None] + _CORNERS[:, 1:] * V[of_one, None]
        form = scene.surfaces[of_one].astype(float)
        uv = (_CORNERS * form[:, None, :2] + form[:, None, 2:4]) / size
        faces = _FACES + 4 * np.arange(len(of_one))[:, None, None]
        light = 255.0 * 255.0 * float(scene.surfaces[q, 4]) if q in glowing else 0.0
        made = Surface(corners.reshape(-1, 3), uv.reshape(-1, 2), faces.reshape(-1, 3), picture, glow=light)
        yield _finished(made, shiny.get(q))


def _finished(surface: Surface, reflector: Reflector | None) -> Surface:
    if reflector is None:
        return surface
    solid: Finish = "mirror" if reflector.share >= _MIRROR_LEAST else "gloss"
    return surface._replace(finish="glass" if reflector.clear else solid, share=reflector.share)


def _meshes(scene: MeshScene) -> Iterator[Surface]:
    for kind in np.unique(scene.kinds).tolist():
        of_kind: BoolArray = scene.kinds == kind
        corners = scene.corners[of_kind].astype(float).reshape(-1, 3)
        uv = scene.uv[of_kind].astype(float).reshape(-1, 2) * [1.0, -1.0] + [0.0, 1.0]
        picture, colour = np.ones((1, 1, 3), np.float32), scene.colours[kind, :3]
        row, lw, lh = scene.pictures[kind].tolist()
        if row >= 0:
            begin = int(scene.levels[row, 0])
            texels = scene.texels[begin : begin + (1 << lw + lh)].reshape(1 << lh, 1 << lw)
            bytes_ = np.stack([texels >> shift & 255 for shift in (0, 8, 16)], axis=-1)
            picture = np.square(bytes_.astype(np.float32) / 255.0)
        begin, lw, lh = scene.hole_places[kind].tolist()
        alpha = None
        if begin >= 0:
            alpha = scene.holes[begin : begin + (1 << lw + lh)].reshape(1 << lh, 1 << lw).astype(np.float32) / 255.0
        faces = np.arange(len(corners)).reshape(-1, 3)
        shown = np.asarray(picture * colour, np.float32)
        yield Surface(corners, uv, faces, picture=shown, alpha=alpha, both_sides=True)


def _gazebo_lamp(row: FloatArray) -> LitLamp:
    """From a row of the bake: as bright at 2 m as its attenuation says, farther away by the inverse square."""
    if row[0] == 2.0:
        return LitLamp("directional", row[1:4], row[4:7], float(row[7]))
    fade = 1.0 / max(row[9] + row[10] * _MEASURED_M + row[11] * _MEASURED_M**2, 0.25)
    strength = float(row[7] * fade * _MEASURED_M**2)
    kind: Literal["spot", "point"] = "spot" if row[0] == 1.0 else "point"
    return LitLamp(kind, place=row[1:4], direction=row[4:7], strength=strength, cutoff_rad=float(np.arccos(row[12])))
