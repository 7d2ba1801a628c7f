"""Glossy floors, mirrors and glass: a second look at the same scene, by a camera behind the reflecting plane.

A camera mirrored at a plane sees through it what the plane reflects (planar reflections of real-time graphics). What it
sees is mixed into the picture where the surface is seen, by Schlick's share for the angle of view (Schlick 1994)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.sim.moving_quads import Moved, MovingScene
from vsx_ros.sim.renderer import Picture, Renderer
from vsx_ros.sim.scene import Quad, quads
from vsx_ros.sim.world import World

MIRROR_SHARE, GLASS_SHARE = 0.9, 0.08  # of light from straight ahead; a pane has two surfaces
_IN_FRONT_M = 0.001  # of the plane, what it can reflect


class Reflector(NamedTuple):
    """A surface: normal @ point = offset [m], the normal towards the viewer. share: of light from straight ahead that
    it reflects. clear: what is behind it is seen. quads: its numbers in the scene."""

    normal: FloatArray
    offset: float
    share: float
    clear: bool
    quads: IntArray


class ShinyScene(NamedTuple):
    """A scene with surfaces that reflect."""

    scene: Scene | MovingScene
    reflectors: list[Reflector]


def reflectors_of(world: World) -> list[Reflector]:
    """The reflecting surfaces of a world."""
    found = []
    for number, quad in enumerate(quads(world)):
        kind = world.materials[quad.material].kind
        share = {"mirror": MIRROR_SHARE, "glass": GLASS_SHARE}.get(kind, 0.0)
        if number == 0:  # the floor
            share = world.hard.get("glossy-floor", 0.0)
        if share:
            found.append(_reflector(quad, number, share, clear=kind == "glass"))
    return found


def _reflector(quad: Quad, number: int, share: float, *, clear: bool) -> Reflector:
    normal = np.cross(quad.edge_v, quad.edge_u)
    normal = normal / np.linalg.norm(normal)
    offset = float(normal @ quad.corner)
    return Reflector(normal=normal, offset=offset, share=share, clear=clear, quads=np.array([number]))


def _mirrored(reflector: Reflector, R: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses (..., 3, 3), (..., 3) behind the plane; as reflections, their determinant is -1."""
    n = reflector.normal
    turn = np.eye(3) - 2.0 * np.outer(n, n)
    behind = t - 2.0 * ((t @ n) - reflector.offset)[..., None] * n
    return np.ascontiguousarray(turn @ R), np.ascontiguousarray(behind)


class ShinyRenderer(Renderer):
    """Images of a scene with surfaces that reflect. Reflections are those of the middle of the exposure, and reflect
    nothing again."""

    def __init__(self, shiny: ShinyScene, camera: PinholeCamera, threads: int = 1) -> None:
        super().__init__(shiny.scene, camera, threads)
        self._reflectors = shiny.reflectors
        self._clear = np.concatenate([NONE, *(r.quads for r in shiny.reflectors if r.clear)])
        scene = shiny.scene.scene if isinstance(shiny.scene, MovingScene) else shiny.scene
        still = int(shiny.scene.first[0]) if isinstance(shiny.scene, MovingScene) else len(scene.P)
        corners = scene.P[:still, None] + np.stack([0.0 * scene.U, scene.U, scene.V, scene.U + scene.V], axis=1)[:still]
        self._before = [self._can_be_reflected(r, corners, len(scene.P)) for r in self._reflectors]
        rows, columns = slice(1, camera.height + 1), slice(1, camera.width + 1)
        x, y = self._rx[rows, columns], self._ry[rows, columns]
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        self._rays = np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True), np.float32)

    @staticmethod
    def _can_be_reflected(reflector: Reflector, corners: Points3, count: int) -> BoolArray:
        """(Q,) which quads reach before the plane; all those of movers."""
        before = np.ones(count, bool)
        before[: len(corners)] = (corners @ reflector.normal).max(axis=1) > reflector.offset + _IN_FRONT_M
        return before

    def render(
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False, moved: Moved | None = None
    ) -> Picture:
        """As ``Renderer.render``. Depth and ident are of what is seen through glass."""
        seen = self._seen(R, t, moved)
        behind_glass = seen._replace(pool=seen.pool[~np.isin(seen.pool, self._clear)])
        picture = surfaces = self._drawn(behind_glass, bayer, want_depth=True)
        if len(self._clear):
            surfaces = self._drawn(self._seen(R[:1], t[:1], moved_first(moved)), bayer, want_depth=True)
        middle = len(R) // 2
        once = slice(middle, middle + 1)
        for reflector, before in zip(self._reflectors, self._before):
            where = np.isin(surfaces.ident, reflector.quads)
            if where.any():
                seen = self._seen(*_mirrored(reflector, R[once], t[once]), moved_first(moved, middle))
                reflected = self._drawn(seen._replace(pool=seen.pool[before[seen.pool]]), bayer, want_depth=False)
                share = self._share(reflector, R[middle, R.shape[1] // 2])[where]
                picture.radiance[where] += share * (reflected.radiance[where] - picture.radiance[where])
        return picture

    def _share(self, reflector: Reflector, R: FloatArray) -> NDArray[np.float32]:
        """(H, W) of the light that is reflected towards each pixel."""
        cosine = np.abs(self._rays @ (R.T @ reflector.normal).astype(np.float32))
        return np.asarray(reflector.share + (1.0 - reflector.share) * (1.0 - cosine) ** 5, np.float32)


NONE = np.zeros(0, np.int64)


def moved_first(moved: Moved | None, sub_frame: int = 0) -> Moved | None:
    """The movers at one sub-frame alone."""
    if moved is None:
        return None
    return moved._replace(R=moved.R[sub_frame : sub_frame + 1], t=moved.t[sub_frame : sub_frame + 1])
