"""The emulated camera's optics in a world of triangles: exact lens, rolling shutter, motion blur and several samples a
pixel over the z-buffer."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.kernels.geometry import project_points
from vsx_ros.kernels.sim.mesh_boxes import HIGH, WIDE, Optics
from vsx_ros.kernels.sim.mesh_raster import rasterise
from vsx_ros.kernels.sim.mesh_scene import MeshScene, Rays, fill_rays
from vsx_ros.kernels.sim.mesh_shade import shade_rows
from vsx_ros.kernels.sim.raycast_shade import TILE
from vsx_ros.sim.mesh_scene import spheres_around
from vsx_ros.sim.moving_mesh import MeshMovers
from vsx_ros.sim.renderer import Picture, blur_sub_frames, lit, ray_tables

MOST_PASSES = 8  # to save time: each draws the whole image
SHARP_ONE, SHARP_MANY = 0.25, 0.06  # squared shortest share of a texture's footprint, at one sample and at several
_LATTICE = 48, 64  # rows and columns of the table of directions
_SLACK_M = 0.05  # of a group of triangles, for the camera's motion during an image


class MeshRenderer:
    """Images of a mesh through a camera: the same methods as ``Renderer``. samples: rays a pixel, at least; motion blur
    may need more. ``threads`` share the rows; any number gives the same bits. movers: whose triangles come last in the
    scene."""

    def __init__(
        self, scene: MeshScene, camera: PinholeCamera, threads: int = 1, samples: int = 4,
        movers: MeshMovers | None = None,
    ) -> None:  # fmt: skip
        self.camera = camera
        self._samples, self._movers = samples, movers
        own = scene if movers is None else scene._replace(corners=scene.corners.copy(), spheres=scene.spheres.copy())
        self._scene = own
        self._threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._rx, self._ry = ray_tables(camera)
        inside = lit(camera, _all_pixels(camera)).reshape(camera.height, camera.width)
        x, y = (rays[1 : camera.height + 1, 1 : camera.width + 1][inside] for rays in (self._rx, self._ry))
        self._widest = float(np.hypot(x, y).max())
        self._still = _still_optics(camera, x.astype(float), y.astype(float), _bow(self._rx, self._ry))
        height, width = camera.height, camera.width
        directions = np.zeros((height + 1, 3, width + 1), np.float32)
        self._rays = Rays(directions, np.zeros((height + 1, 3)), np.zeros((height + 1, 3, 3)))
        self._nearness, self._ident = np.zeros((height, width), np.float32), np.full((height, width), -1, np.int32)

    @property
    def border_rows(self) -> FloatArray:
        """(B,) image rows at which ``render`` takes poses; the last may lie below the image."""
        return np.arange(math.ceil(self.camera.height / TILE) + 1, dtype=float) * TILE

    def sub_frames(self, R: FloatArray, t: FloatArray) -> int:
        """As ``blur_sub_frames``; at least as many as samples, at most 8 or these."""
        return max(self._samples, min(blur_sub_frames(self.camera, R, t), MOST_PASSES))

    def enlighten(self, stamp_ns: int) -> None:
        """Nothing: the light of a Gazebo world is steady."""

    def render(
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False,
        states: FloatArray | None = None,
    ) -> Picture:  # fmt: skip
        """As ``Renderer.render``, where ident is the triangle. Movers stand where they are at the middle row, once for
        each sub-frame."""
        moved = None if self._movers is None or states is None else self._movers.placed(states)
        passes, shape = len(R), (self.camera.height, self.camera.width)
        radiance = np.zeros(shape, np.float32)
        for s in range(passes):
            # Points of a low-discrepancy sequence inside the pixel; a single one lies in its centre.
            jitter = [((s * step + 0.5) % 1.0 - 0.5) for step in (0.7548776662, 0.5698402910)]
            self._place(moved, s)
            self._draw(R[s], t[s], jitter, (bayer, 1.0 / passes, SHARP_MANY if passes > 1 else SHARP_ONE), radiance)
        if not want_depth:
            return Picture(radiance, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.int32))
        self._place(moved, passes // 2)
        self._draw(R[passes // 2], t[passes // 2], [0.0, 0.0], None, radiance)
        met = self._nearness > 0.0
        depth = np.divide(1.0, self._nearness, out=np.zeros(shape, np.float32), where=met)
        return Picture(radiance, depth, self._ident.copy())

    def _place(self, moved: Float32Array | None, sub_frame: int) -> None:
        """Write the triangles (S, T, 3, 3) of the movers at a sub-frame into the scene."""
        if moved is None or self._movers is None:
            return
        spheres = spheres_around(moved[sub_frame], self._movers.seen.starts)
        self._scene.corners[-moved.shape[1] :] = moved[sub_frame].reshape(-1, 9)
        self._scene.spheres[-len(spheres) :] = spheres

    def _draw(
        self, R: FloatArray, t: FloatArray, jitter: list[float], shading: tuple[bool, float, float] | None,
        radiance: NDArray[np.float32],
    ) -> None:  # fmt: skip
        """One pass. shading: Bayer mosaic, share of the image, sharpness; None for the geometry alone."""
        rays, height = self._rays, self.camera.height
        fill_rays(self._rx, self._ry, R, t, jitter[0], jitter[1], rays)
        order = self._near_first(rays.turns[height // 2], rays.origins[height // 2])
        turn = float(np.linalg.norm(np.diff(R, axis=0), axis=(1, 2)).max(initial=0.0)) / math.sqrt(2.0) / TILE
        shift = float(np.linalg.norm(np.diff(t, axis=0), axis=1).max(initial=0.0)) / TILE
        optics = self._still._replace(turn=turn, shift=shift, jitter=np.array(jitter))

        def rows(first: int, last: int) -> None:
            rasterise(self._scene, order, rays, optics, first, last, self._nearness, self._ident)
            if shading is not None:
                bayer, share, sharp = shading
                shade_rows(
                    self._scene, rays, self._nearness, self._ident, first, last, sharp, bayer, share, radiance
                )  # fmt: skip

        if self._pool is None:
            rows(0, height)
            return
        cuts = np.linspace(0, height, self._threads + 1).astype(int)
        for done in [self._pool.submit(rows, int(a), int(b)) for a, b in zip(cuts[:-1], cuts[1:])]:
            done.result()

    def _near_first(self, R: FloatArray, t: FloatArray) -> IntArray:
        """The groups of triangles that may be seen from T_world_cam, near ones first."""
        spheres = self._scene.spheres
        cam = (spheres[:, :3] - t) @ R
        radius = spheres[:, 3] + _SLACK_M
        aside = np.hypot(cam[:, 0], cam[:, 1])
        slope = math.hypot(1.0, self._widest)
        seen = ((aside - self._widest * cam[:, 2]) / slope < radius) & (cam[:, 2] > -radius)
        gap = np.linalg.norm(cam, axis=1) - radius
        chosen = np.flatnonzero(seen)
        return np.asarray(chosen[np.argsort(gap[chosen], kind="stable")], np.int64)


def _all_pixels(camera: PinholeCamera) -> FloatArray:
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return np.column_stack([u.ravel(), v.ravel()]).astype(float)


def _bow(rx: NDArray[np.float32], ry: NDArray[np.float32]) -> float:
    """How far a ray lies from what its tile's corners give by interpolation, at most."""
    bend = 0.0
    for rays in (rx, ry):
        for along, half in ((rays, WIDE // 2), (rays.T, HIGH // 2)):
            middle = 0.5 * (along[:, : -2 * half] + along[:, 2 * half :])
            bend = max(bend, float(np.abs(along[:, half:-half] - middle).max()))
    return 3.0 * bend + 1e-6


def _still_optics(camera: PinholeCamera, x: FloatArray, y: FloatArray, bow: float) -> Optics:
    """The table from directions to pixels for the rays x, y of the lit pixels, of a camera at rest. Directions beyond
    the outermost ray, where a lens may be undefined, are drawn in to it."""
    bounds = np.array([x.min(), y.min(), x.max(), y.max()])
    gx, gy = np.meshgrid(
        *(np.linspace(bounds[i], bounds[i + 2], n + 1) for i, n in ((0, _LATTICE[1]), (1, _LATTICE[0])))
    )
    radius = np.hypot(gx, gy)
    inwards = np.minimum(1.0, float(np.hypot(x, y).max()) / np.maximum(radius, 1e-9))
    plane = np.column_stack([(gx * inwards).ravel(), (gy * inwards).ravel()])
    pixels = np.asarray(project_points(kernel_camera(camera), plane), float).reshape(*gx.shape, 2)
    per_step = np.array(_LATTICE[::-1]) / (bounds[2:] - bounds[:2])
    as_given = inwards >= 1.0
    bends = [
        (np.abs(np.diff(pixels, 2, axis=axis)).max(axis=2) * per_step[1 - axis] ** 2)[
            np.take(as_given, range(0, n - 1), axis) & np.take(as_given, range(2, n + 1), axis)
        ]
        for axis, n in enumerate(_LATTICE)
    ]
    curvature = max(float(bend.max(initial=0.0)) for bend in bends)
    return Optics(
        pixels=np.ascontiguousarray(pixels, np.float32),
        bounds=bounds,
        per_step=per_step,
        slack=0.05 + 0.25 * curvature / float(per_step.min()) ** 2,
        curvature=curvature,
        bow=bow,
        jitter=np.zeros(2),
        turn=0.0,
        shift=0.0,
    )
