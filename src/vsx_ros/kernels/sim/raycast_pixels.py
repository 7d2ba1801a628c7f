"""Lists of pixels in scratch memory: filled from the rays of a tile, and laid into the picture once they are shaded."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.kernels.sim.raycast_shade import (
    DXX,
    DXY,
    DYX,
    DYY,
    F0,
    PIXEL,
    ROW,
    RX,
    RY,
    SUM,
    TILE,
    TOTAL,
    WEIGHT,
    Scratch,
)


class View(NamedTuple):
    """What is drawn: forms (S, B, Q, 9) of ``plane_forms``; rx, ry: rays, pixel (y, x) at [y + 1, x + 1], padded to
    whole tiles and two more; bayer: each pixel sees one colour of the GRBG mosaic, otherwise all see grey."""

    scene: Scene
    forms: FloatArray
    rx: Float32Array
    ry: Float32Array
    bayer: bool


@kernel
def enter(
    scratch: Scratch, i: int, view: View, y: int, x: int, ratio: np.float32, weight: np.float32, width: int
) -> None:
    """Append pixel (y, x) to the shading list at place i."""
    f, g, rx, ry = scratch.f, scratch.g, view.rx, view.ry
    f[RX + i] = rx[y + 1, x + 1]
    f[RY + i] = ry[y + 1, x + 1]
    f[DXX + i] = rx[y + 1, x + 2] - rx[y + 1, x + 1]
    f[DXY + i] = ry[y + 1, x + 2] - ry[y + 1, x + 1]
    f[DYX + i] = rx[y + 2, x + 1] - rx[y + 1, x + 1]
    f[DYY + i] = ry[y + 2, x + 1] - ry[y + 1, x + 1]
    f[ROW + i] = ratio
    f[WEIGHT + i] = weight
    g[PIXEL + i] = np.int32(y * width + x)


@kernel
def enter_rows(f: Float32Array, view: View, y0: int, y1: int, x0: int, x1: int) -> int:
    """List every pixel of a tile, row by row; TOTAL becomes zero. Returns their number."""
    rx, ry = view.rx, view.ry
    n = 0
    for y in range(y0, y1):
        ratio = np.float32((y - y0) / (1.0 * TILE))
        x_line, y_line, x_next, y_next = rx[y + 1], ry[y + 1], rx[y + 2], ry[y + 2]
        for x in range(x0 + 1, x1 + 1):
            i = n + x - x0 - 1
            f[RX + i] = x_line[x]
            f[RY + i] = y_line[x]
            f[DXX + i] = x_line[x + 1] - x_line[x]
            f[DXY + i] = y_line[x + 1] - y_line[x]
            f[DYX + i] = x_next[x] - x_line[x]
            f[DYY + i] = y_next[x] - y_line[x]
            f[ROW + i] = ratio
            f[TOTAL + i] = F0
        n += x1 - x0
    return n


@kernel
def _tint_index(y: int, x: int, bayer: bool) -> int:
    """Which reflectance a pixel sees: 3 grey, or by the GRBG mosaic (even rows green, red; odd rows blue, green)."""
    if not bayer:
        return 3
    if (y & 1) == (x & 1):
        return 1
    return 0 if (y & 1) == 0 else 2


@kernel
def spread_rows(
    f: Float32Array, tint: Float32Array, bayer: bool, y0: int, y1: int, x0: int, x1: int, share: np.float32,
    picture: Float32Array,
) -> None:  # fmt: skip
    """Write TOTAL, tinted, to the tile of the picture (H, W)."""
    i = 0
    for y in range(y0, y1):
        even = share * tint[_tint_index(y, x0, bayer)]
        odd = share * tint[_tint_index(y, x0 + 1, bayer)]
        line = picture[y]
        for x in range(x0, x1):
            line[x] = f[TOTAL + i + x - x0] * (odd if (x - x0) & 1 else even)
        i += x1 - x0


@kernel
def spread(scratch: Scratch, n: int, tint: Float32Array, bayer: bool, share: np.float32, picture: Float32Array) -> None:
    """Add SUM, tinted and weighted, to the listed pixels of the picture (H, W)."""
    f, g = scratch.f, scratch.g
    width = picture.shape[1]
    for i in range(n):
        y, x = g[PIXEL + i] // width, g[PIXEL + i] % width
        picture[y, x] += share * f[WEIGHT + i] * tint[_tint_index(y, x, bayer)] * f[SUM + i]
