"""The emulated camera's optics: exact lens, rolling shutter and motion blur over the tile ray caster."""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Points3
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry import lens
from vsx_ros.geometry.camera import PinholeCamera, kernel_camera, usable
from vsx_ros.kernels.geometry import project_points, unproject_pixels
from vsx_ros.kernels.lens import PICTURE_R2, PLANE_R2
from vsx_ros.kernels.sim.raycast_pixels import View
from vsx_ros.kernels.sim.raycast_render import render_tile_rows
from vsx_ros.kernels.sim.raycast_shade import TILE
from vsx_ros.sim.drawn_world import DrawnWorld, Seen
from vsx_ros.sim.moving_quads import Moved

BLUR_STEP_PX = 1.2  # between sub-frames, so that blur looks even
MAX_SUB_FRAMES = 16  # to save time
MOST_OFF_AXIS_RAD = math.radians(85.0)  # rays lie on the plane z = 1; beyond, the picture is black


class Picture(NamedTuple):
    """Radiance before the sensor. radiance: (H, W) float32, 1 = white paper at unit irradiance. depth: (H, W) float32
    distance along the optical axis [m], 0 where nothing is hit. ident: (H, W) int32 quad, -1 for nothing. Both are
    empty unless requested."""

    radiance: NDArray[np.float32]
    depth: NDArray[np.float32]
    ident: NDArray[np.int32]


def lit(camera: PinholeCamera, pixels: FloatArray) -> BoolArray:
    """(N,) whether light falls on the (N, 2) pixels: up to ``MOST_OFF_AXIS_RAD`` off the axis. Raises CalibrationError
    when the distortion cannot be inverted for all of these."""
    known, array = (camera.model, camera.distortion), kernel_camera(camera)
    holds = lens.FOLD_SHARE * lens.fold_angle(*known)
    within = (holds, min(holds, MOST_OFF_AXIS_RAD))
    invertible, inside = (_nearer(array, pixels, float(r)) for r in lens.radius(*known, np.array(within)))
    if holds < MOST_OFF_AXIS_RAD and not invertible.all():
        raise CalibrationError(f"the distortion {camera.distortion} cannot be inverted over the whole image")
    return inside


def _nearer(array: FloatArray, pixels: FloatArray, radius: float) -> BoolArray:
    """Which pixels are nearer to the centre than ``radius`` focal lengths."""
    array[PICTURE_R2] = radius**2
    return usable(array, pixels)


def exact_rays(camera: PinholeCamera, pixels: FloatArray) -> Points3:
    """(N, 3) rays with z = 1 through (N, 2) pixels, exact to rounding; pixels without light get the rim's rays. Raises
    CalibrationError when the distortion cannot be inverted for pixels with light."""
    array, inside = kernel_camera(camera), lit(camera, pixels)
    array[PLANE_R2] = math.tan(MOST_OFF_AXIS_RAD) ** 2
    plane = unproject_pixels(array, pixels)
    if not np.abs(project_points(array, plane) - pixels)[inside].max(initial=0.0) <= 1e-6:
        raise CalibrationError(f"the distortion {camera.distortion} cannot be inverted over the whole image")
    plane[~inside] *= (math.tan(MOST_OFF_AXIS_RAD) / np.linalg.norm(plane[~inside], axis=1))[:, None]
    return np.column_stack([plane, np.ones(len(plane))])


def ray_tables(camera: PinholeCamera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """x and y of the rays with z = 1: pixel (y, x) at [y + 1, x + 1], padded to whole tiles and two more."""
    height, width = math.ceil(camera.height / TILE) * TILE + 3, math.ceil(camera.width / TILE) * TILE + 3
    v, u = np.mgrid[0:height, 0:width]
    # Padding beyond the sensor repeats its border's slope: the polynomial may not be invertible there.
    inner_u = np.clip(u - 1, 0, camera.width - 1)
    inner_v = np.clip(v - 1, 0, camera.height - 1)
    pixels = np.column_stack([inner_u.ravel(), inner_v.ravel()]).astype(float)
    rays = exact_rays(camera, pixels).reshape(height, width, 3)
    x = rays[..., 0] + (u - 1 - inner_u) / camera.fx
    y = rays[..., 1] + (v - 1 - inner_v) / camera.fy
    return np.ascontiguousarray(x, np.float32), np.ascontiguousarray(y, np.float32)


def blur_sub_frames(camera: PinholeCamera, R: FloatArray, t: FloatArray) -> int:
    """Number of sub-frames for the motion between two poses (2, 3, 3), (2, 3) during the exposure: one per 1.2 px
    of blur, averaged over the image's corners and centre for things 1 m away."""
    u, v = camera.width - 1.0, camera.height - 1.0
    pixels = np.array([[0, 0], [u, 0], [0, v], [u, v], [u / 2, v / 2]])
    rays = np.column_stack([(pixels[:, 0] - camera.cx) / camera.fx,
                            (pixels[:, 1] - camera.cy) / camera.fy, np.ones(5)])  # fmt: skip
    moved = (rays @ R[0].T + t[0] - t[1]) @ R[1]
    shift = moved[:, :2] / moved[:, 2:] - rays[:, :2]
    blur_px = float(np.hypot(shift[:, 0] * camera.fx, shift[:, 1] * camera.fy).mean())
    return max(math.ceil(blur_px / BLUR_STEP_PX), 1)


class Renderer:
    """Images of a world through a camera. ``threads`` share the rows; any number gives the same bits."""

    def __init__(self, world: DrawnWorld, camera: PinholeCamera, threads: int = 1) -> None:
        self.camera = camera
        self._world = world.at(0)
        self._threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self.tile_rows = math.ceil(camera.height / TILE)
        self._rx, self._ry = ray_tables(camera)
        self._bounds = self._tile_bounds()

    @property
    def border_rows(self) -> FloatArray:
        """(B,) image rows of the tile borders at which ``render`` takes poses; the last may lie below the image."""
        return np.arange(self.tile_rows + 1, dtype=float) * TILE

    def _tile_bounds(self) -> FloatArray:
        """(rows, columns, 4) least and greatest rx, least and greatest ry of each tile and its ring."""
        shape = (TILE + 2, TILE + 2)
        x, y = (sliding_window_view(rays, shape)[::TILE, ::TILE] for rays in (self._rx, self._ry))
        bounds = [x.min((2, 3)), x.max((2, 3)), y.min((2, 3)), y.max((2, 3))]
        return np.stack(bounds, axis=-1).astype(np.float64)

    def sub_frames(self, R: FloatArray, t: FloatArray) -> int:
        """As ``blur_sub_frames``, at most 16."""
        return min(blur_sub_frames(self.camera, R, t), MAX_SUB_FRAMES)

    def enlighten(self, stamp_ns: int) -> None:
        """Draw the next images in the light of this moment, if it changes."""
        self._world = self._world.at(stamp_ns)

    def render(
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False,
        states: FloatArray | None = None,
    ) -> Picture:  # fmt: skip
        """The image from poses T_world_cam at S sub-frames of the exposure and B borders of tile rows: R (S, B, 3, 3),
        t (S, B, 3) [m]. bayer: each pixel sees one colour of the GRBG mosaic; otherwise all see grey. states: of the
        movers (S, B, K), in a world that has some."""
        return self._picture(R, t, bayer, want_depth, self._world.moved(states))

    def _picture(self, R: FloatArray, t: FloatArray, bayer: bool, want_depth: bool, moved: Moved | None) -> Picture:
        return self._drawn(self._world.seen(R, t, moved), bayer, want_depth)

    def _drawn(self, seen: Seen, bayer: bool, want_depth: bool) -> Picture:
        scene, forms, pool = seen
        shape = (self.camera.height, self.camera.width)
        radiance = np.zeros(shape, np.float32)
        depth = np.zeros(shape if want_depth else (0, 0), np.float32)
        ident = np.full(shape if want_depth else (0, 0), -1, np.int32)
        view = View(scene=scene, forms=forms, rx=self._rx, ry=self._ry, bayer=bayer)

        def rows(first: int, last: int) -> None:
            render_tile_rows(first, last, view, pool, self._bounds, radiance, depth, ident)

        if self._pool is None:
            rows(0, self.tile_rows)
        else:
            cuts = np.linspace(0, self.tile_rows, 2 * self._threads + 1).astype(int)
            for done in [self._pool.submit(rows, int(a), int(b)) for a, b in zip(cuts[:-1], cuts[1:])]:
                done.result()
        return Picture(radiance, depth, ident)
