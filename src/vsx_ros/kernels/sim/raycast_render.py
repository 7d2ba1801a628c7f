"""Tile-binned ray caster for textured quads: the emulated camera's picture before the sensor.

Each tile of 16 x 16 pixels keeps the quads it may see (raycast_cull), finds the nearest per ray, and hands (pixel,
weight) lists, one per quad, to raycast_shade. Pixels at the edge of a quad are divided by 3 x 3 sub-samples.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_cull import candidates, overlap
from vsx_ros.kernels.sim.raycast_shade import (
    EPS,
    F0,
    F1,
    FLOAT_ROWS,
    INT_ROWS,
    SUM,
    TILE,
    TOTAL,
    N,
    enter,
    enter_rows,
    shade,
    spread,
    spread_rows,
)  # fmt: skip

RING = TILE + 2
THIRD = np.float32(1.0 / 3.0)

Area: TypeAlias = tuple[int, int, int, int]
"""y0, y1, x0, x1 of a tile [px], cut at the edges of the picture."""

Memory: TypeAlias = tuple[Float32Array, Int32Array, Int32Array]
"""Scratch: float rows, the same memory as bits, integer rows."""

Scene: TypeAlias = tuple[Int32Array, Int32Array, Float32Array, Int32Array, Float32Array]
"""Texels, light, surfaces, places, tints: see ``render_tile_rows``."""


@kernel
def _tile_forms(forms: FloatArray, s: int, b: int, quads: IntArray, n: int, m: Float32Array) -> None:
    """m (n, 18) float32: forms at the upper border and their change to the lower one."""
    for k in range(n):
        for j in range(9):
            top = forms[s, b, quads[k], j]
            m[k, j] = np.float32(top)
            m[k, 9 + j] = np.float32(forms[s, b + 1, quads[k], j] - top)


@kernel
def _visibility(
    m: Float32Array,
    n: int,
    rx: Float32Array,
    ry: Float32Array,
    y0: int,
    x0: int,
    nearest: Float32Array,
    winner: Int32Array,
) -> None:
    """Nearest quad of each ray of the tile and the ring of pixels around it; flat (RING * RING)."""
    for i in range(RING * RING):
        nearest[i] = F0
        winner[i] = np.int32(-1)
    for k in range(n):
        label = np.int32(k)
        for i in range(RING):
            ratio = np.float32((i - 1.0) / TILE)
            a0, a1, a2 = m[k, 0] + ratio * m[k, 9], m[k, 1] + ratio * m[k, 10], m[k, 2] + ratio * m[k, 11]
            b0, b1, b2 = m[k, 3] + ratio * m[k, 12], m[k, 4] + ratio * m[k, 13], m[k, 5] + ratio * m[k, 14]
            c0, c1, c2 = m[k, 6] + ratio * m[k, 15], m[k, 7] + ratio * m[k, 16], m[k, 8] + ratio * m[k, 17]
            line_x = rx[y0 + i]
            line_y = ry[y0 + i]
            at = i * RING
            for j in range(RING):
                dx, dy = line_x[x0 + j], line_y[x0 + j]
                a = a0 * dx + a1 * dy + a2
                b = b0 * dx + b1 * dy + b2
                c = c0 * dx + c1 * dy + c2
                low, high = -EPS * c, c + EPS * c
                hit = (c > nearest[at + j]) & (a >= low) & (a <= high) & (b >= low) & (b <= high)
                nearest[at + j] = c if hit else nearest[at + j]
                winner[at + j] = label if hit else winner[at + j]


@kernel
def _edge_weights(
    m: Float32Array, n: int, rx: Float32Array, ry: Float32Array, y: int, x: int, row: np.float32, weights: Float32Array
) -> None:
    """Share of 3x3 sub-samples of pixel (y, x) that each of the n quads wins (weights, (n,))."""
    dxx, dxy = rx[y + 1, x + 2] - rx[y + 1, x + 1], ry[y + 1, x + 2] - ry[y + 1, x + 1]
    dyx, dyy = rx[y + 2, x + 1] - rx[y + 1, x + 1], ry[y + 2, x + 1] - ry[y + 1, x + 1]
    ratio = row
    for k in range(n):
        weights[k] = F0
    for i in range(3):
        oy = np.float32(i - 1) * THIRD
        for j in range(3):
            ox = np.float32(j - 1) * THIRD
            dx = rx[y + 1, x + 1] + ox * dxx + oy * dyx
            dy = ry[y + 1, x + 1] + ox * dxy + oy * dyy
            best = F0
            who = -1
            for k in range(n):
                c = (m[k, 6] + ratio * m[k, 15]) * dx + (m[k, 7] + ratio * m[k, 16]) * dy
                c += m[k, 8] + ratio * m[k, 17]
                if c <= best:
                    continue
                a = (m[k, 0] + ratio * m[k, 9]) * dx + (m[k, 1] + ratio * m[k, 10]) * dy
                a += m[k, 2] + ratio * m[k, 11]
                if a < -EPS * c or a > c + EPS * c:
                    continue
                b = (m[k, 3] + ratio * m[k, 12]) * dx + (m[k, 4] + ratio * m[k, 13]) * dy
                b += m[k, 5] + ratio * m[k, 14]
                if b < -EPS * c or b > c + EPS * c:
                    continue
                best = c
                who = k
            if who >= 0:
                weights[who] += F1
    for k in range(n):
        weights[k] /= np.float32(9.0)


@kernel
def _covered_tile(
    area: Area, m: Float32Array, forms: FloatArray, ty: int, quads: IntArray, memory: Memory, rx: Float32Array,
    ry: Float32Array, scene: Scene, bayer: bool, picture: Float32Array,
) -> None:  # fmt: skip
    """Fill a tile that one quad covers alone. area: y0, y1, x0, x1."""
    y0, y1, x0, x1 = area
    f, bits, g = memory
    tex, light, surfaces, places, tints = scene
    quad = quads[0]
    sub_frames = forms.shape[0]
    n = enter_rows(f, rx, ry, y0, y1, x0, x1)
    for s in range(sub_frames):
        _tile_forms(forms, s, ty, quads, 1, m)
        shade(f, bits, g, n, tex, light, m, 0, surfaces[quad], places[quad], _jitter(s, sub_frames))
        for i in range(n):
            f[TOTAL + i] += f[SUM + i]
    spread_rows(f, tints[quad], bayer, y0, y1, x0, x1, F1 / np.float32(sub_frames), picture)


@kernel
def _jitter(s: int, sub_frames: int) -> np.float32:
    """Where between two mip levels sub-frame s decides; -1 without sub-frames."""
    return np.float32(-1.0) if sub_frames == 1 else np.float32((s + 0.5) / sub_frames)


@kernel
def _mark_edges(
    area: Area,
    m: Float32Array,
    n: int,
    rx: Float32Array,
    ry: Float32Array,
    winner: Int32Array,
    edge_at: Int32Array,
    edge_weight: Float32Array,
) -> int:
    """List the pixels with a differing neighbour and their shares; winner becomes -2 there. Returns their number."""
    y0, y1, x0, x1 = area
    weights = np.empty(n, dtype=np.float32)
    edges = 0
    for y in range(y0, y1):
        for x in range(x0, x1):
            at = (y - y0 + 1) * RING + x - x0 + 1
            who = winner[at]
            left, right, above, below = winner[at - 1], winner[at + 1], winner[at - RING], winner[at + RING]
            if left != who or right != who or above != who or below != who:
                _edge_weights(m, n, rx, ry, y, x, np.float32((y - y0) / TILE), weights)
                edge_at[edges] = at
                for k in range(n):
                    edge_weight[k, edges] = weights[k]
                edges += 1
    for i in range(edges):
        winner[edge_at[i]] = np.int32(-2)
    return edges


@kernel
def _mixed_tile(
    area: Area, m: Float32Array, quads: IntArray, n: int, memory: Memory, rx: Float32Array, ry: Float32Array,
    scene: Scene, bayer: bool, share: np.float32, jitter: np.float32, picture: Float32Array, winner: Int32Array,
    edge_at: Int32Array, edge_weight: Float32Array,
) -> None:  # fmt: skip
    """Add one sub-frame of a tile of several quads, given the winner of each ray."""
    y0, y1, x0, x1 = area
    width = picture.shape[1]
    f, bits, g = memory
    tex, light, surfaces, places, tints = scene
    edges = _mark_edges(area, m, n, rx, ry, winner, edge_at, edge_weight)
    for k in range(n):
        count = 0
        for y in range(y0, y1):
            ratio = np.float32((y - y0) / TILE)
            at = (y - y0 + 1) * RING + 1
            for x in range(x0, x1):
                if winner[at + x - x0] == k:
                    enter(f, g, count, rx, ry, y, x, ratio, F1, width)
                    count += 1
        for i in range(edges):
            if edge_weight[k, i] > F0:
                row, column = edge_at[i] // RING - 1, edge_at[i] % RING - 1
                enter(f, g, count, rx, ry, y0 + row, x0 + column, np.float32(row / TILE), edge_weight[k, i], width)
                count += 1
        if count > 0:
            quad = quads[k]
            shade(f, bits, g, count, tex, light, m, k, surfaces[quad], places[quad], jitter)
            spread(f, g, count, tints[quad], bayer, share, picture)


@kernel
def _note_depth(
    area: Area, quads: IntArray, nearest: Float32Array, winner: Int32Array, depth: Float32Array, ident: Int32Array
) -> None:
    """Depth [m] and quad of each pixel of the tile."""
    y0, y1, x0, x1 = area
    for y in range(y0, y1):
        for x in range(x0, x1):
            at = (y - y0 + 1) * RING + x - x0 + 1
            if winner[at] >= 0:
                depth[y, x] = F1 / nearest[at]
                ident[y, x] = quads[winner[at]]


@kernel
def render_tile_rows(
    first: int, last: int, forms: FloatArray, pool: IntArray, bounds: FloatArray, rx: Float32Array, ry: Float32Array,
    scene: Scene, bayer: bool, picture: Float32Array, depth: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Render the rows of tiles first <= row < last into picture (H, W) float32, which must be zero there.

    forms: (S, B, Q, 9) of ``plane_forms``. pool: (K,) visible quads. bounds: (rows, columns, 4) least and greatest rx,
    least and greatest ry of a tile with its ring. rx, ry: rays, pixel (y, x) at [y + 1, x + 1], padded to whole tiles
    and two more. scene: packed texels and packed light (int32); surfaces (Q, 5) float32: texels along U, V, offsets,
    light scale; places (Q, 5) int32: texture base, log2 of its size, light base, light nodes along U and V; tints
    (Q, 4): r, g, b, grey. depth (H, W) [m] and ident (H, W) take the pixel centre's values of the first sub-frame;
    size 0 skips them.
    """
    height, width = picture.shape
    f = np.zeros(FLOAT_ROWS * N, dtype=np.float32)
    memory = (f, f.view(np.int32), np.zeros(INT_ROWS * N, dtype=np.int32))
    strip = np.empty(len(pool) + 1, dtype=np.int64)
    found = np.empty(len(pool) + 1, dtype=np.int64)
    cover = np.empty(len(pool) + 1, dtype=np.bool_)
    m = np.empty((len(pool) + 1, 18), dtype=np.float32)
    nearest = np.empty(RING * RING, dtype=np.float32)
    winner = np.empty(RING * RING, dtype=np.int32)
    edge_at = np.empty(N, dtype=np.int32)
    edge_weight = np.empty((len(pool) + 1, N), dtype=np.float32)
    sub_frames = forms.shape[0]
    share = F1 / np.float32(sub_frames)
    for ty in range(first, last):
        x_min, x_max = bounds[ty, :, 0].min(), bounds[ty, :, 1].max()
        y_min, y_max = bounds[ty, :, 2].min(), bounds[ty, :, 3].max()
        n_strip = 0
        for i in range(len(pool)):
            if overlap(forms, ty, pool[i], x_min, x_max, y_min, y_max) > 0:
                strip[n_strip] = pool[i]
                n_strip += 1
        for tx in range(bounds.shape[1]):
            n, alone = candidates(forms, ty, strip, n_strip, bounds[ty, tx], found, cover)
            y0, x0 = ty * TILE, tx * TILE
            area = (y0, min(y0 + TILE, height), x0, min(x0 + TILE, width))
            for s in range(0 if alone and depth.size == 0 else sub_frames):
                _tile_forms(forms, s, ty, found, n, m)
                _visibility(m, n, rx, ry, y0, x0, nearest, winner)
                if s == 0 and depth.size > 0:
                    _note_depth(area, found, nearest, winner, depth, ident)
                if not alone:
                    _mixed_tile(
                        area, m, found, n, memory, rx, ry, scene, bayer, share, _jitter(s, sub_frames), picture, winner,
                        edge_at, edge_weight,
                    )  # fmt: skip
            if alone:
                _covered_tile(area, m, forms, ty, found, memory, rx, ry, scene, bayer, picture)
