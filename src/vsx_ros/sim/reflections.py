"""Glossy floors, mirrors and glass: a second look at the same scene, by a camera behind the reflecting plane.

A camera mirrored at a plane sees through it what the plane reflects (planar reflections of real-time graphics). What it
sees is mixed into the picture where the surface is seen, by Schlick's share for the angle of view (Schlick 1994)."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Points3
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.moving_quads import Moved
from vsx_ros.sim.reflectors import Reflector
from vsx_ros.sim.renderer import Picture, Renderer

NONE = np.zeros(0, np.int64)
_IN_FRONT_M = 0.001  # of the plane, what it can reflect


def _mirrored(reflector: Reflector, R: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses (..., 3, 3), (..., 3) behind the plane; as reflections, their determinant is -1."""
    n = reflector.normal
    turn = np.eye(3) - 2.0 * np.outer(n, n)
    behind = t - 2.0 * ((t @ n) - reflector.offset)[..., None] * n
    return np.ascontiguousarray(turn @ R), np.ascontiguousarray(behind)


class ShinyRenderer(Renderer):
    """Images of a world with surfaces that reflect. Reflections are those of the middle of the exposure, and reflect
    nothing again."""

    def __init__(self, world: DrawnWorld, camera: PinholeCamera, threads: int = 1) -> None:
        super().__init__(world, camera, threads)
        self._clear = np.concatenate([NONE, *(r.quads for r in world.reflectors if r.clear)])
        P, U, V = world.scene.P, world.scene.U, world.scene.V
        still = len(P) - (0 if world.movers is None else len(world.movers.quads))
        corners = P[:still, None] + np.stack([0.0 * U, U, V, U + V], axis=1)[:still]
        self._before = [self._can_be_reflected(r, corners, len(P)) for r in world.reflectors]
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

    def _picture(self, R: FloatArray, t: FloatArray, bayer: bool, want_depth: bool, moved: Moved | None) -> Picture:
        """As of ``Renderer``. Depth and ident are of what is seen through glass."""
        seen = self._world.seen(R, t, moved)
        behind_glass = seen._replace(pool=seen.pool[~np.isin(seen.pool, self._clear)])
        picture = surfaces = self._drawn(behind_glass, bayer, want_depth=True)
        if len(self._clear):
            first = self._world.seen(R[:1], t[:1], moved and moved.at(0))
            surfaces = self._drawn(first, bayer, want_depth=True)
        middle = len(R) // 2
        once, there = slice(middle, middle + 1), moved and moved.at(middle)
        for reflector, before in zip(self._world.reflectors, self._before):
            where = np.isin(surfaces.ident, reflector.quads)
            if where.any():
                seen = self._world.seen(*_mirrored(reflector, R[once], t[once]), there)
                reflected = self._drawn(seen._replace(pool=seen.pool[before[seen.pool]]), bayer, want_depth=False)
                share = self._share(reflector, R[middle, R.shape[1] // 2])[where]
                picture.radiance[where] += share * (reflected.radiance[where] - picture.radiance[where])
        return picture

    def _share(self, reflector: Reflector, R: FloatArray) -> NDArray[np.float32]:
        """(H, W) of the light that is reflected towards each pixel."""
        cosine = np.abs(self._rays @ (R.T @ reflector.normal).astype(np.float32))
        return np.asarray(reflector.share + (1.0 - reflector.share) * (1.0 - cosine) ** 5, np.float32)
