"""8x8 patches: warp, zero-mean SSD at corners, inverse-compositional sub-pixel alignment (Klein and Murray 2007, 5.4).

A template of a map point is a 24x24 uint8 patch of its source level; the point itself is at (12, 12) plus an offset
within half a pixel."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Int32Array, IntArray
from vsx_ros.kernels import kernel

I32 = np.int32
PATCH = 24
CENTRE = 12
TEMPLATE = 10
_ITERATIONS = 10
# A match is judged against the template's own contrast: loosely at whole pixels (half a pixel of misfit costs much
# on a sharp edge), strictly once it is aligned. The floor is what sensor noise alone costs.
MAX_SHARE, MAX_ALIGNED_SHARE, NOISE_FLOOR = 0.6, 0.25, 2000.0


class Target(NamedTuple):
    """An image to search: pixels (B,), its whole pyramid; table (4, 4) with rows (offset, height, width, first row
    index); corners (N, 2), x and y in level pixels, sorted by level and row; row_table: for every row of every level
    the index of its first corner, one closing entry per level."""

    pixels: NDArray[np.uint8]
    table: IntArray
    corners: Int32Array
    row_table: IntArray


@kernel
def quantize(template: Int32Array, core: Int32Array) -> float:
    """Fill core (64,) int32 with the inner 8x8 of the template in grey levels; returns its contrast, the sum of squared
    deviations from the mean."""
    total, squares = np.int32(0), np.int32(0)
    for j in range(8):
        for i in range(8):
            value = np.int32((template[np.uint64(j + 1), np.uint64(i + 1)] + 8) >> 4)
            core[np.uint64(8 * j + i)] = value
            total = np.int32(total + value)
            squares = np.int32(squares + value * value)
    return float(squares) - float(total) * float(total) / 64.0


@kernel
def zmssd(pixels: NDArray[np.uint8], start: int, width: int, core: Int32Array) -> float:
    """Zero-mean sum of squared differences between the core and the 8x8 image patch whose first pixel is ``start``."""
    # 32-bit sums and unsigned indices (no test for negative ones) let the compiler vectorise: three times faster.
    total, squares = np.int32(0), np.int32(0)
    for j in range(8):
        row = start + j * width
        for i in range(8):
            d = np.int32(np.int32(pixels[np.uint64(row + i)]) - core[np.uint64(8 * j + i)])
            total = np.int32(total + d)
            squares = np.int32(squares + np.int32(d * d))
    return float(squares) - float(total) * float(total) / 64.0


@kernel
def best_corner(target: Target, level: int, x: float, y: float, radius: float, core: Int32Array) -> tuple[float, int]:
    """(lowest ZMSSD, its corner index or -1) among the corners of a level within a radius [level px]."""
    pixels, table, corners, row_table = target
    offset, height, width, first = table[level, 0], table[level, 1], table[level, 2], table[level, 3]
    best = np.inf
    winner = -1
    r2 = radius * radius
    y0 = max(4, int(math.ceil(y - radius)))
    y1 = min(height - 5, int(math.floor(y + radius)))
    for row in range(y0, y1 + 1):
        dy2 = (row - y) * (row - y)
        for c in range(row_table[first + row], row_table[first + row + 1]):
            cx = corners[c, 0]
            dx = cx - x
            if dx < -radius:
                continue
            if dx > radius:
                break
            if dx * dx + dy2 > r2 or cx < 4 or cx > width - 5:
                continue
            score = zmssd(pixels, offset + (row - 4) * width + cx - 4, width, core)
            if score < best:
                best = score
                winner = c
    return best, winner


@kernel
def slopes(template: Int32Array, gx: Int32Array, gy: Int32Array) -> tuple[float, float, float, float, float]:
    """Fill gx, gy (64,) int32 with the differences across the inner 8x8 of the template (32 times the slope in grey
    levels per px); returns the sums over it of gx^2, gx gy, gy^2, gx, gy, in grey levels per px."""
    h00, h01, h11, h02, h12 = np.int32(0), np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    one = np.uint64(1)
    for j in range(8):
        for i in range(8):
            u, v, k = np.uint64(j + 1), np.uint64(i + 1), np.uint64(8 * j + i)
            a = np.int32(template[u, v + one] - template[u, v - one])
            b = np.int32(template[u + one, v] - template[u - one, v])
            gx[k] = a
            gy[k] = b
            h00 = I32(h00 + I32(a * a))
            h01 = I32(h01 + I32(a * b))
            h11 = I32(h11 + I32(b * b))
            h02 = I32(h02 + a)
            h12 = I32(h12 + b)
    return h00 / 1024.0, h01 / 1024.0, h11 / 1024.0, h02 / 32.0, h12 / 32.0


@kernel
def misfit(
    pixels: NDArray[np.uint8], start: int, width: int, fx: float, fy: float, template: Int32Array, gx: Int32Array,
    gy: Int32Array,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Sums over 8x8 of r gx, r gy, r and r^2, where r is the image's grey level at (fx, fy) right of and below
    ``start`` minus the template's. Grey levels and px.

    In whole numbers (1/16 grey levels, weights of 1/4096 px), whose sums the compiler may reorder and vectorise; none
    of them reaches 2^31. It does so only where every product is cut to 32 bits at once."""
    w11 = I32(fx * fy * 4096.0)
    w10 = I32(I32(fx * 4096.0) - w11)
    w01 = I32(I32(fy * 4096.0) - w11)
    w00 = I32(I32(4096) - I32(w11 + w10) - w01)
    b0, b1, b2, squares = I32(0), I32(0), I32(0), I32(0)
    one = np.uint64(1)
    for j in range(8):
        p = start + j * width
        for i in range(8):
            a, b, k = np.uint64(p + i), np.uint64(p + width + i), np.uint64(8 * j + i)
            top = I32(I32(w00 * I32(pixels[a])) + I32(w10 * I32(pixels[a + one])))
            bottom = I32(I32(w01 * I32(pixels[b])) + I32(w11 * I32(pixels[b + one])))
            value = I32(I32(I32(top + bottom) + I32(128)) >> I32(8))
            r = I32(value - template[np.uint64(j + 1), np.uint64(i + 1)])
            b0 = I32(b0 + I32(r * gx[k]))
            b1 = I32(b1 + I32(r * gy[k]))
            b2 = I32(b2 + r)
            squares = I32(squares + I32(r * r))
    return b0 / 512.0, b1 / 512.0, b2 / 16.0, squares / 256.0


@kernel
def refine(
    pixels: NDArray[np.uint8], layout: IntArray, template: Int32Array, x: float, y: float
) -> tuple[bool, float, float, float]:
    """Inverse-compositional alignment of the template's inner 8x8 (x, y and mean difference) from a start [level px] in
    the level whose row of the table is ``layout``.

    Returns (converged, x, y, zero-mean squared difference). Converged: last step below 0.03 px, at most 2 px from the
    start, patch inside the image."""
    offset, height, width = layout[0], layout[1], layout[2]
    gx, gy = np.empty(64, np.int32), np.empty(64, np.int32)
    h00, h01, h11, h02, h12 = slopes(template, gx, gy)
    # The mean difference is eliminated first, what is left is 2x2.
    s00 = h00 - h02 * h02 / 64.0
    s01 = h01 - h02 * h12 / 64.0
    s11 = h11 - h12 * h12 / 64.0
    det = s00 * s11 - s01 * s01
    if det < 1e-3 * (s00 + s11) * (s00 + s11) or det < 1.0:
        return False, x, y, np.inf
    start_x, start_y = x, y
    for _ in range(_ITERATIONS):
        left, top = x - 4.0, y - 4.0
        if left < 0.0 or top < 0.0 or left + 8.0 >= width or top + 8.0 >= height:
            return False, x, y, np.inf
        ix, iy = int(left), int(top)
        b0, b1, b2, squares = misfit(pixels, offset + iy * width + ix, width, left - ix, top - iy, template, gx, gy)
        c0 = b0 - h02 * b2 / 64.0
        c1 = b1 - h12 * b2 / 64.0
        dx = (s11 * c0 - s01 * c1) / det
        dy = (s00 * c1 - s01 * c0) / det
        x -= dx
        y -= dy
        if abs(x - start_x) > 2.0 or abs(y - start_y) > 2.0:
            return False, x, y, np.inf
        if dx * dx + dy * dy < 0.0009:
            return True, x, y, squares - b2 * b2 / 64.0
    return False, x, y, np.inf


@kernel
def best_pixel(target: Target, level: int, x: float, y: float, reach: int, core: Int32Array) -> tuple[float, int, int]:
    """(lowest ZMSSD, x, y) among the whole pixels within ``reach`` of a place, corner or not."""
    pixels, table = target.pixels, target.table
    offset, height, width = table[level, 0], table[level, 1], table[level, 2]
    best, bx, by = np.inf, 0, 0
    cx, cy = int(math.floor(x + 0.5)), int(math.floor(y + 0.5))
    for row in range(max(4, cy - reach), min(height - 5, cy + reach) + 1):
        for column in range(max(4, cx - reach), min(width - 5, cx + reach) + 1):
            score = zmssd(pixels, offset + (row - 4) * width + column - 4, width, core)
            if score < best:
                best, bx, by = score, column, row
    return best, bx, by
