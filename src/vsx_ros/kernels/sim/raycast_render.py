"""Tile-binned ray caster for textured quads: the emulated camera's picture before the sensor.

Each tile of 16 x 16 pixels keeps the quads it may see (raycast_cull), finds the nearest per ray, and hands (pixel,
weight) lists, one per quad, to raycast_shade. Pixels at the edge of a quad are divided by 3 x 3 sub-samples."""

from typing import TypeAlias

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_cull import candidates, overlap
from vsx_ros.kernels.sim.raycast_pixels import View, enter, spread
from vsx_ros.kernels.sim.raycast_shade import EPS, F0, F1, FLOATS, INTEGERS, SUM, TILE, TOTAL, N, Scratch, shade

RING = TILE + 2
THIRD = np.float32(1.0 / 3.0)

Area: TypeAlias = tuple[int, int, int, int]  # y0, y1, x0, x1 of a tile [px], cut at the edges of the picture


@kernel
def _tile_forms(forms: FloatArray, s: int, b: int, quads: IntArray, n: int, m: Float32Array) -> None:
    """m (n, 18) float32: forms at the upper border and their change to the lower one."""
    for k in range(n):
        for j in range(9):
            top = forms[s, b, quads[k], j]
            m[k, j] = np.float32(top)
            m[k, 9 + j] = np.float32(forms[s, b + 1, quads[k], j] - top)


@kernel
def _visibility(scratch: Scratch, n: int, view: View, y0: int, x0: int) -> None:
    """Nearest quad of each ray of the tile and the ring of pixels around it; flat (RING * RING)."""
    m, nearest, winner, rx, ry = scratch.m, scratch.nearest, scratch.winner, view.rx, view.ry
    nearest[:], winner[:] = F0, np.int32(-1)
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
    m: Float32Array, n: int, view: View, y: int, x: int, ratio: np.float32, weights: Float32Array
) -> None:
    """Share of 3x3 sub-samples of pixel (y, x) that each of the n quads wins (weights, (n,))."""
    rx, ry = view.rx, view.ry
    dxx, dxy = rx[y + 1, x + 2] - rx[y + 1, x + 1], ry[y + 1, x + 2] - ry[y + 1, x + 1]
    dyx, dyy = rx[y + 2, x + 1] - rx[y + 1, x + 1], ry[y + 2, x + 1] - ry[y + 1, x + 1]
    weights[:] = F0
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
def _enter_won(area: Area, view: View, k: int, scratch: Scratch) -> int:
    """List the pixels of a tile whose rays the quad in place k wins, row by row; returns their number."""
    y0, y1, x0, x1 = area
    winner, count = scratch.winner, 0
    for y in range(y0, y1):
        ratio = np.float32((y - y0) / TILE)
        at = (y - y0 + 1) * RING + 1
        for x in range(x0, x1):
            if winner[at + x - x0] == k:
                enter(scratch, count, view, y, x, ratio, F1)
                count += 1
    return count


@kernel
def _covered_tile(area: Area, view: View, ty: int, quads: IntArray, scratch: Scratch, picture: Float32Array) -> None:
    """Fill a tile that one quad covers alone."""
    f, sub_frames = scratch.f, view.forms.shape[0]
    scratch.winner[:] = np.int32(0)
    n = _enter_won(area, view, 0, scratch)
    f[TOTAL : TOTAL + n] = F0
    for s in range(sub_frames):
        _tile_forms(view.forms, s, ty, quads, 1, scratch.m)
        shade(scratch, n, view.scene, 0, quads[0], _jitter(s, sub_frames))
        for i in range(n):
            f[TOTAL + i] += f[SUM + i]
    f[SUM : SUM + n] = f[TOTAL : TOTAL + n]
    spread(scratch, n, view.scene.tints[quads[0]], view.bayer, F1 / np.float32(sub_frames), picture)


@kernel
def _jitter(s: int, sub_frames: int) -> np.float32:
    """Position of sub-frame s between two mip levels; -1 without sub-frames."""
    return np.float32(-1.0) if sub_frames == 1 else np.float32((s + 0.5) / sub_frames)


@kernel
def _mark_edges(area: Area, scratch: Scratch, n: int, view: View) -> int:
    """List the pixels with a differing neighbour and their shares; winner becomes -2 there. Returns their number."""
    y0, y1, x0, x1 = area
    winner, edge_at, edge_weight = scratch.winner, scratch.edge_at, scratch.edge_weight
    edges = 0
    for y in range(y0, y1):
        for x in range(x0, x1):
            at = (y - y0 + 1) * RING + x - x0 + 1
            who = winner[at]
            left, right, above, below = winner[at - 1], winner[at + 1], winner[at - RING], winner[at + RING]
            if left != who or right != who or above != who or below != who:
                _edge_weights(scratch.m, n, view, y, x, np.float32((y - y0) / TILE), edge_weight[edges, :n])
                edge_at[edges] = at
                edges += 1
    for i in range(edges):
        winner[edge_at[i]] = np.int32(-2)
    return edges


@kernel
def _mixed_tile(
    area: Area, view: View, quads: IntArray, n: int, scratch: Scratch, share: np.float32, jitter: np.float32,
    picture: Float32Array,
) -> None:  # fmt: skip
    """Add one sub-frame of a tile of several quads, given the winner of each ray."""
    y0, _, x0, _ = area
    edge_at, edge_weight = scratch.edge_at, scratch.edge_weight
    edges = _mark_edges(area, scratch, n, view)
    for k in range(n):
        count = _enter_won(area, view, k, scratch)
        for i in range(edges):
            if edge_weight[i, k] > F0:
                row, column = edge_at[i] // RING - 1, edge_at[i] % RING - 1
                enter(scratch, count, view, y0 + row, x0 + column, np.float32(row / TILE), edge_weight[i, k])
                count += 1
        if count > 0:
            shade(scratch, count, view.scene, k, quads[k], jitter)
            spread(scratch, count, view.scene.tints[quads[k]], view.bayer, share, picture)


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
    first: int, last: int, view: View, pool: IntArray, bounds: FloatArray, picture: Float32Array, depth: Float32Array,
    ident: Int32Array,
) -> None:  # fmt: skip
    """Render the rows of tiles first <= row < last into picture (H, W) float32, which must be zero there. pool: (K,)
    visible quads. bounds: (rows, columns, 4) least and greatest rx, least and greatest ry of a tile with its ring.
    depth (H, W) [m] and ident (H, W) take the pixel centre's values of the first sub-frame; size 0 skips them."""
    height, width = picture.shape
    f, most = np.zeros(FLOATS, dtype=np.float32), len(pool) + 1
    scratch = Scratch(
        f=f, bits=f.view(np.int32), g=np.zeros(INTEGERS, dtype=np.int32), m=np.empty((most, 18), dtype=np.float32),
        nearest=np.empty(RING * RING, dtype=np.float32), winner=np.empty(RING * RING, dtype=np.int32),
        edge_at=np.empty(N, dtype=np.int32), edge_weight=np.empty((N, most), dtype=np.float32),
    )  # fmt: skip
    strip, found, cover = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64), np.empty(most, dtype=np.bool_)
    forms, sub_frames = view.forms, view.forms.shape[0]
    share = F1 / np.float32(sub_frames)
    for ty in range(first, last):
        x_min, x_max = bounds[ty, :, 0].min(), bounds[ty, :, 1].max()
        y_min, y_max = bounds[ty, :, 2].min(), bounds[ty, :, 3].max()
        n_strip = 0
        for q in pool:
            if overlap(forms, ty, q, x_min, x_max, y_min, y_max) > 0:
                strip[n_strip] = q
                n_strip += 1
        for tx in range(bounds.shape[1]):
            n, alone = candidates(forms, ty, strip[:n_strip], bounds[ty, tx], found, cover)
            y0, x0 = ty * TILE, tx * TILE
            area = (y0, min(y0 + TILE, height), x0, min(x0 + TILE, width))
            for s in range(0 if alone and depth.size == 0 else sub_frames):
                _tile_forms(forms, s, ty, found, n, scratch.m)
                _visibility(scratch, n, view, y0, x0)
                if s == 0 and depth.size > 0:
                    _note_depth(area, found, scratch.nearest, scratch.winner, depth, ident)
                if not alone:
                    _mixed_tile(area, view, found, n, scratch, share, _jitter(s, sub_frames), picture)
            if alone:
                _covered_tile(area, view, ty, found, scratch, picture)
