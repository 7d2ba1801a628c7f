"""The arrays of a triangle mesh that is drawn, and the rays of an image through it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_shade import TILE

MIP_LEVELS = 12  # of a picture of 2048 x 2048


class MeshScene(NamedTuple):
    """T triangles of M surfaces. corners (T, 9) [m]; uv (T, 6), v upwards; kinds (T,) surface. chunks (K + 1,): where
    groups of neighbouring triangles begin; spheres (K, 4): centre and radius of each group [m]. colours (M, 4):
    linear reflectance r, g, b, grey. pictures (M, 3): row of ``levels``, log2 of width and height; -1 without one.
    levels (P, 12): where each mip level begins in texels, whose bytes are r, g, b, grey, as the square root of the
    reflectance. holes: alpha of the pictures with holes; hole_places (M, 3): begin, log2 of width and height, or -1.
    light (Z, Y, X, 6): irradiance of faces towards +x, -x, +y, -y, +z, -z at the nodes of a lattice; light_frame (4,):
    its origin and spacing [m]. sky: radiance where nothing is hit. lamps (L, 13), as of ``bake``, and ambient: what the
    light was baked from, in its units."""

    corners: Float32Array
    uv: Float32Array
    kinds: Int32Array
    chunks: Int32Array
    spheres: FloatArray
    colours: Float32Array
    pictures: Int32Array
    levels: Int32Array
    texels: NDArray[np.uint32]
    holes: NDArray[np.uint8]
    hole_places: Int32Array
    light: Float32Array
    light_frame: FloatArray
    sky: float
    lamps: FloatArray
    ambient: float


class Rays(NamedTuple):
    """The rays of an image of H x W pixels in the world. directions (H + 1, 3, W + 1) float32, length 1 along the
    optical axis, the last row and column for differences only. origins (H + 1, 3), turns (H + 1, 3, 3): T_world_cam of
    each row."""

    directions: Float32Array
    origins: FloatArray
    turns: FloatArray


@kernel
def fill_rays(
    rx: Float32Array, ry: Float32Array, R: FloatArray, t: FloatArray, jitter_x: float, jitter_y: float, rays: Rays
) -> None:
    """Rays of poses R (B, 3, 3), t (B, 3) at the borders of tile rows, between them interpolated. rx, ry: pixel (y, x)
    at [y + 1, x + 1]. jitter: offset from the pixels' centres [px]."""
    last, width = R.shape[0] - 2, rays.directions.shape[2]
    jx, jy = np.float32(jitter_x), np.float32(jitter_y)
    for y in range(rays.directions.shape[0]):
        b = min(y // TILE, last)
        share = (y - b * TILE) / TILE
        for i in range(3):
            rays.origins[y, i] = t[b, i] + share * (t[b + 1, i] - t[b, i])
            for j in range(3):
                rays.turns[y, i, j] = R[b, i, j] + share * (R[b + 1, i, j] - R[b, i, j])
        for i in range(3):
            r0, r1, r2 = (
                np.float32(rays.turns[y, i, 0]), np.float32(rays.turns[y, i, 1]), np.float32(rays.turns[y, i, 2]),
            )  # fmt: skip
            line = rays.directions[y, i]
            for x in range(width):
                px, py = rx[y + 1, x + 1], ry[y + 1, x + 1]
                dx = px + jx * (rx[y + 1, x + 2] - px) + jy * (rx[y + 2, x + 1] - px)
                dy = py + jx * (ry[y + 1, x + 2] - py) + jy * (ry[y + 2, x + 1] - py)
                line[x] = r0 * dx + r1 * dy + r2
