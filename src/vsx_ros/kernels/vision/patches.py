"""8x8 patches: squared differences at corners, inverse-compositional sub-pixel alignment (Klein and Murray 2007, 5.4).

A template of a map point is a 24x24 uint8 patch of its source level; the point itself is at (12, 12) plus an offset
within half a pixel. Light changes: patches are compared after the gain and offset that fit the image best to the
template, as in normalised correlation (within ``GAINS``)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Int32Array, IntArray
from vsx_ros.kernels import kernel, part

I32 = np.int32
PATCH = 24
CENTRE = 12
TEMPLATE = 10
_ITERATIONS = 10
# A match is judged against the template's own contrast: loosely at whole pixels (half a pixel of misfit costs much
# on a sharp edge), strictly once it is aligned. The floor is what sensor noise alone costs.
MAX_SHARE, MAX_ALIGNED_SHARE, NOISE_FLOOR = 0.55, 0.22, 2000.0
# Allowed gain by light: with more, any bare wall matches a faint template, and noise a sharp one.
GAINS = (0.4, 2.5)


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
    """Fill core (64,) int32 with the inner 8x8 of the template minus its mean, in 1/16 grey levels; returns its
    contrast, the sum of squared grey levels."""
    total, squares = np.int32(0), np.int32(0)
    for j in range(8):
        for i in range(8):
            total = I32(total + template[np.uint64(j + 1), np.uint64(i + 1)])
    mean = I32(total >> I32(6))
    # So many pixels lose 1/16 more, so that the sum is exactly zero and the image's mean has no effect.
    left = I32(total - I32(mean * I32(64)))
    for j in range(8):
        for i in range(8):
            k = np.uint64(8 * j + i)
            value = I32(template[np.uint64(j + 1), np.uint64(i + 1)] - mean - I32(I32(8 * j + i) < left))
            core[k] = value
            squares = I32(squares + I32(value * value))
    return squares / 256.0


@part
def relit_difference(energy: float, contrast: float, product: float) -> float:
    """Sum of squared differences between a template of given contrast and an image of given energy (sums of squares
    about the means; product: the sum of their products) after the best gain and offset of the image."""
    gain = min(max(product / max(energy, 1.0), GAINS[0]), GAINS[1])
    return contrast - gain * (2.0 * product - gain * energy)


@kernel
def relit_ssd(pixels: NDArray[np.uint8], start: int, width: int, core: Int32Array, contrast: float) -> float:
    """Sum of squared differences between the core and the 8x8 image patch whose first pixel is ``start``, after the
    patch's best gain and offset."""
    # 32-bit sums and unsigned indices (no test for negative ones) let the compiler vectorise: three times faster.
    total, squares, product = np.int32(0), np.int32(0), np.int32(0)
    for j in range(8):
        row = start + j * width
        for i in range(8):
            value = I32(pixels[np.uint64(row + i)])
            total = I32(total + value)
            squares = I32(squares + I32(value * value))
            product = I32(product + I32(value * core[np.uint64(8 * j + i)]))
    return relit_difference(float(squares) - float(total) * float(total) / 64.0, contrast, product / 16.0)


@kernel
def best_corner(
    target: Target, level: int, x: float, y: float, radius: float, core: Int32Array, contrast: float
) -> tuple[float, int]:
    """(lowest difference, its corner index or -1) among the corners of a level within a radius [level px]."""
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
            score = relit_ssd(pixels, offset + (row - 4) * width + cx - 4, width, core, contrast)
            if score < best:
                best = score
                winner = c
    return best, winner


class Slopes(NamedTuple):
    """Sums over the inner 8x8 of a template of gx^2, gx gy, gy^2, of gx and gy, and of their products with the core.
    Grey levels and px."""

    xx: float
    xy: float
    yy: float
    x: float
    y: float
    core_x: float
    core_y: float


@kernel
def slopes(template: Int32Array, core: Int32Array, gx: Int32Array, gy: Int32Array) -> Slopes:
    """Fill gx, gy (64,) int32 with the differences across the inner 8x8 of the template (32 times the slope in grey
    levels per px)."""
    xx, xy, yy, x, y = np.int32(0), np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    core_x, core_y = np.int32(0), np.int32(0)
    one = np.uint64(1)
    for j in range(8):
        for i in range(8):
            u, v, k = np.uint64(j + 1), np.uint64(i + 1), np.uint64(8 * j + i)
            a = np.int32(template[u, v + one] - template[u, v - one])
            b = np.int32(template[u + one, v] - template[u - one, v])
            gx[k] = a
            gy[k] = b
            xx = I32(xx + I32(a * a))
            xy = I32(xy + I32(a * b))
            yy = I32(yy + I32(b * b))
            x = I32(x + a)
            y = I32(y + b)
            core_x = I32(core_x + I32(a * core[k]))
            core_y = I32(core_y + I32(b * core[k]))
    return Slopes(xx / 1024.0, xy / 1024.0, yy / 1024.0, x / 32.0, y / 32.0, core_x / 512.0, core_y / 512.0)


@kernel
def misfit(
    pixels: NDArray[np.uint8], start: int, width: int, fx: float, fy: float, template: Int32Array, core: Int32Array,
    gx: Int32Array, gy: Int32Array,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Sums over 8x8 of r gx, r gy, r core, r and r^2, where r is the image's grey level at (fx, fy) right of and below
    ``start`` minus the template's. Grey levels and px.

    Integers (1/16 grey levels, weights of 1/4096 px), so that the compiler can reorder and vectorise the sums; none of
    them reaches 2^31. It vectorises only if every product is cut to 32 bits at once."""
    w11 = I32(fx * fy * 4096.0)
    w10 = I32(I32(fx * 4096.0) - w11)
    w01 = I32(I32(fy * 4096.0) - w11)
    w00 = I32(I32(4096) - I32(w11 + w10) - w01)
    b0, b1, along, total, squares = I32(0), I32(0), I32(0), I32(0), I32(0)
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
            along = I32(along + I32(r * core[k]))
            total = I32(total + r)
            squares = I32(squares + I32(r * r))
    return b0 / 512.0, b1 / 512.0, along / 256.0, total / 16.0, squares / 256.0


@kernel
def refine(
    pixels: NDArray[np.uint8], layout: IntArray, template: Int32Array, core: Int32Array, contrast: float, x: float,
    y: float,
) -> tuple[bool, float, float, float]:  # fmt: skip
    """Align the template's inner 8x8 (inverse-compositional; x, y, gain, offset) from a start [px] in the level with
    table row ``layout``. core, contrast: see ``quantize``. Returns (converged, x, y, squared difference after gain
    and offset). Converged: last step below 0.03 px, at most 2 px from the start, patch inside the image."""
    offset, height, width = layout[0], layout[1], layout[2]
    gx, gy = np.empty(64, np.int32), np.empty(64, np.int32)
    h = slopes(template, core, gx, gy)
    contrast = max(contrast, 1.0)  # gain and offset are projected out (Baker and Matthews, IJCV 2004, part 3)
    s00 = h.xx - h.x * h.x / 64.0 - h.core_x * h.core_x / contrast
    s01 = h.xy - h.x * h.y / 64.0 - h.core_x * h.core_y / contrast
    s11 = h.yy - h.y * h.y / 64.0 - h.core_y * h.core_y / contrast
    det = s00 * s11 - s01 * s01
    if det < 1e-3 * (s00 + s11) * (s00 + s11) or det < 1.0:
        return False, x, y, np.inf
    start_x, start_y = x, y
    for _ in range(_ITERATIONS):
        left, top = x - 4.0, y - 4.0
        if left < 0.0 or top < 0.0 or left + 8.0 >= width or top + 8.0 >= height:
            return False, x, y, np.inf
        ix, iy = int(left), int(top)
        b0, b1, along, total, squares = misfit(
            pixels, offset + iy * width + ix, width, left - ix, top - iy, template, core, gx, gy
        )
        product = contrast + along
        brighter = det * min(max(product / contrast, 1.0 / GAINS[1]), 1.0 / GAINS[0])
        c0 = b0 - h.x * total / 64.0 - h.core_x * along / contrast
        c1 = b1 - h.y * total / 64.0 - h.core_y * along / contrast
        dx = (s11 * c0 - s01 * c1) / brighter
        dy = (s00 * c1 - s01 * c0) / brighter
        x -= dx
        y -= dy
        if abs(x - start_x) > 2.0 or abs(y - start_y) > 2.0:
            return False, x, y, np.inf
        if dx * dx + dy * dy < 0.0009:
            energy = squares - total * total / 64.0 + 2.0 * along + contrast
            return True, x, y, relit_difference(energy, contrast, product)
    return False, x, y, np.inf


@kernel
def best_pixel(
    target: Target, level: int, x: float, y: float, reach: int, core: Int32Array, contrast: float
) -> tuple[float, int, int]:
    """(lowest difference, x, y) among the whole pixels within ``reach`` of a place, corner or not."""
    pixels, table = target.pixels, target.table
    offset, height, width = table[level, 0], table[level, 1], table[level, 2]
    best, bx, by = np.inf, 0, 0
    cx, cy = int(math.floor(x + 0.5)), int(math.floor(y + 0.5))
    for row in range(max(4, cy - reach), min(height - 5, cy + reach) + 1):
        for column in range(max(4, cx - reach), min(width - 5, cx + reach) + 1):
            score = relit_ssd(pixels, offset + (row - 4) * width + column - 4, width, core, contrast)
            if score < best:
                best, bx, by = score, column, row
    return best, bx, by
