"""Texture and light of listed pixels: the shading half of the ray caster.

The loops run over flat scratch memory with constant offsets, so that they compile to vector instructions. Texels are
packed: an int32 holds the 2x2 neighbourhood of a texel, so that one load feeds a bilinear lookup."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, Int32Array
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_cull import Scene

TILE = 16
N = TILE * TILE

# Rows of the float scratch memory, each N long.
FLOATS = 22 * N
RX, RY, DXX, DXY, DYX, DYY, ROW, WEIGHT, TU, TV, MU = range(0, FLOATS // 2, N)
MV, LOD, SUM, FX, FY, SCALE, MIX, VALUE, LU, LV, TOTAL = range(FLOATS // 2, FLOATS, N)
# Rows of the integer scratch memory.
INTEGERS = 6 * N
Y, X, INDEX, SHIFT, BASE, TEXEL = range(0, INTEGERS, N)

F0 = np.float32(0.0)
F1 = np.float32(1.0)
EPS = np.float32(1e-5)
MAX_PROBES = 8
HALF = np.float32(0.5)
TINY = np.float32(1e-12)
NEAR = np.float32(1e-4)
LOG2_SCALE = np.float32(1.0 / (1 << 23))
LOG2_BIAS = np.float32(127.0)
BYTE = np.int32(255)
INVERSE_OF_3 = np.int32(-1431655765)


class Scratch(NamedTuple):
    """Memory of one tile: float rows, the same memory as bits, integer rows; m (K, 18): forms of the quads at its upper
    border and their change to the lower one; inverse depth and place in m of the nearest quad of each ray; pixels at
    the edges of quads (N,) and how much of them each quad covers (N, K)."""

    f: Float32Array
    bits: Int32Array
    g: Int32Array
    m: Float32Array
    nearest: Float32Array
    winner: Int32Array
    edge_at: Int32Array
    edge_weight: Float32Array


@kernel
def _footprint(
    f: Float32Array, n: int, m: Float32Array, k: int, surface: Float32Array, lu: np.float32, lv: np.float32
) -> tuple[np.float32, np.float32]:
    """Texture coordinates and the axes of the pixel's footprint, in texels of the finest level. Leaves TU, TV, LU, LV,
    the major axis (MU, MV), its length in LOD and the minor length in MIX; returns the largest ratio of the axes and
    the largest major axis."""
    su, sv, ou, ov = surface[0], surface[1], surface[2], surface[3]
    a0, a1, a2, b0, b1, b2, c0, c1, c2 = m[k, 0], m[k, 1], m[k, 2], m[k, 3], m[k, 4], m[k, 5], m[k, 6], m[k, 7], m[k, 8]
    p0, p1, p2, q0, q1, q2 = m[k, 9], m[k, 10], m[k, 11], m[k, 12], m[k, 13], m[k, 14]
    r0, r1, r2 = m[k, 15], m[k, 16], m[k, 17]
    for i in range(n):
        t, dx, dy = f[ROW + i], f[RX + i], f[RY + i]
        a0t, a1t, b0t, b1t, c0t, c1t = a0 + t * p0, a1 + t * p1, b0 + t * q0, b1 + t * q1, c0 + t * r0, c1 + t * r1
        c = max(c0t * dx + c1t * dy + (c2 + t * r2), NEAR)
        inverse = F1 / c
        u = (a0t * dx + a1t * dy + (a2 + t * p2)) * inverse
        v = (b0t * dx + b1t * dy + (b2 + t * q2)) * inverse
        u = min(max(u, F0), F1)
        v = min(max(v, F0), F1)
        xx, xy, yx, yy = f[DXX + i], f[DXY + i], f[DYX + i], f[DYY + i]
        cx, cy = c0t * xx + c1t * xy, c0t * yx + c1t * yy
        ux = (a0t * xx + a1t * xy - u * cx) * inverse * su
        uy = (a0t * yx + a1t * yy - u * cy) * inverse * su
        vx = (b0t * xx + b1t * xy - v * cx) * inverse * sv
        vy = (b0t * yx + b1t * yy - v * cy) * inverse * sv
        p = ux * ux + uy * uy
        q = ux * vx + uy * vy
        r = vx * vx + vy * vy
        h = HALF * (p - r)
        g = np.sqrt(h * h + q * q)
        middle = HALF * (p + r)
        major = np.sqrt(middle + g)
        eu = h + g if h >= F0 else q
        ev = q if h >= F0 else g - h
        length = np.sqrt(eu * eu + ev * ev + TINY)
        scale = major / length
        f[TU + i] = u * su + ou
        f[TV + i] = v * sv + ov
        f[LU + i] = u * lu
        f[LV + i] = v * lv
        f[MU + i] = eu * scale
        f[MV + i] = ev * scale
        f[LOD + i] = major
        f[MIX + i] = np.sqrt(max(middle - g, F0))
    widest = F0
    longest = F0
    for i in range(n):
        longest = max(longest, f[LOD + i])
        widest = max(widest, f[LOD + i] / (f[MIX + i] + TINY))
    return widest, longest


@kernel
def _blended(f: Float32Array, g: Int32Array, i: int) -> np.float32:
    """Bilinear value of the packed texel i."""
    t = g[TEXEL + i]
    t00 = np.float32(t & BYTE)
    t01 = np.float32((t >> np.int32(8)) & BYTE)
    t10 = np.float32((t >> np.int32(16)) & BYTE)
    t11 = np.float32((t >> np.int32(24)) & BYTE)
    upper = t00 + f[FX + i] * (t01 - t00)
    lower = t10 + f[FX + i] * (t11 - t10)
    value: np.float32 = upper + f[FY + i] * (lower - upper)
    return value


@kernel
def _lookup(f: Float32Array, g: Int32Array, tex: Int32Array, n: int, probe: np.float32) -> None:
    """VALUE = bilinear texel at (TU, TV) + probe * (MU, MV), at the level that SCALE, SHIFT and BASE name."""
    for i in range(n):
        x = (f[TU + i] + probe * f[MU + i]) * f[SCALE + i] - HALF
        y = (f[TV + i] + probe * f[MV + i]) * f[SCALE + i] - HALF
        x_floor, y_floor = np.floor(x), np.floor(y)
        f[FX + i] = x - x_floor
        f[FY + i] = y - y_floor
        size = np.int32(1) << g[SHIFT + i]
        column = np.int32(x_floor) & (size - np.int32(1))
        row = np.int32(y_floor) & (size - np.int32(1))
        g[INDEX + i] = g[BASE + i] + (row << g[SHIFT + i]) + column
    for i in range(n):
        g[TEXEL + i] = tex[np.uint32(g[INDEX + i])]
    for i in range(n):
        f[VALUE + i] = _blended(f, g, i)


@kernel
def _level(f: Float32Array, g: Int32Array, n: int, above: np.int32, base: np.int32, size_log2: np.int32) -> None:
    """SCALE, SHIFT and BASE of the mip level floor(LOD) + above, at most the coarsest."""
    whole = np.int32(1) << size_log2
    area = np.int32(4) * whole * whole
    per_whole = F1 / np.float32(whole)
    for i in range(n):
        level = min(np.int32(f[LOD + i]) + above, size_log2)
        shift = size_log2 - level
        size = np.int32(1) << shift
        g[SHIFT + i] = shift
        f[SCALE + i] = np.float32(size) * per_whole
        # The finer levels hold (4 whole^2 - 4 size^2) / 3 texels; 3 divides exactly, by its inverse modulo 2^32.
        g[BASE + i] = base + (area - np.int32(4) * size * size) * INVERSE_OF_3


@kernel
def _level_of_detail(f: Float32Array, bits: Int32Array, n: int, share: np.float32, jitter: np.float32) -> None:
    """LOD = the wanted mip level of a probe of this share of the major axis, SUM = 0; MIX = weight of the next level in
    the blend, 0 where jitter >= 0."""
    for i in range(n):
        f[LOD + i] = max(max(f[MIX + i], f[LOD + i] * share), F1)
    for i in range(n):
        # log2 from the bits of the float: piecewise linear, off by at most 0.09 levels, and continuous.
        lod = np.float32(bits[LOD + i]) * LOG2_SCALE - LOG2_BIAS
        lod = max(lod, F0) + max(jitter, F0)
        f[LOD + i] = lod
        f[MIX + i] = F0 if jitter >= F0 else lod - np.floor(lod)
        f[SUM + i] = F0


@kernel
def _enlighten(
    f: Float32Array, g: Int32Array, light: Int32Array, n: int, base: np.int32, nu: np.int32, nv: np.int32,
    scale: np.float32,
) -> None:  # fmt: skip
    """SUM *= scale * bilinear light at (LU, LV) of the light map of nu x nv that begins at ``base``."""
    top_u, top_v = nu - np.int32(2), nv - np.int32(2)
    for i in range(n):
        column = min(np.int32(f[LU + i]), top_u)
        row = min(np.int32(f[LV + i]), top_v)
        f[FX + i] = f[LU + i] - np.float32(column)
        f[FY + i] = f[LV + i] - np.float32(row)
        g[INDEX + i] = base + row * nu + column
    for i in range(n):
        g[TEXEL + i] = light[np.uint32(g[INDEX + i])]
    for i in range(n):
        f[SUM + i] *= scale * _blended(f, g, i)


@kernel
def shade(scratch: Scratch, n: int, scene: Scene, k: int, quad: int, jitter: np.float32) -> None:
    """Fill SUM with the radiance of the n listed pixels on a quad, in place k: anisotropic texture times light. jitter
    < 0 blends the two mip levels around the wanted one; otherwise the level is floor(wanted + jitter): the mean over
    sub-frames of evenly spread jitters is the blend."""
    f, bits, g, surface, place = scratch.f, scratch.bits, scratch.g, scene.surfaces[quad], scene.places[quad]
    tex, light, light_scale = scene.tex, scene.light, surface[4]
    base, size_log2, light_base, nu, nv = place[0], place[1], place[2], place[3], place[4]
    lu, lv = np.float32(nu - 1), np.float32(nv - 1)
    widest, longest = _footprint(f, n, scratch.m, k, surface, lu, lv)
    probes = max(1, min(MAX_PROBES, int(min(widest, np.float32(64.0)) + HALF)))
    probes = max(1, min(probes, int(min(longest, np.float32(64.0)) + F1)))
    share = F1 / np.float32(probes)
    _level_of_detail(f, bits, n, share, jitter)
    for above in range(2 if f[MIX : MIX + n].max() > F0 else 1):
        _level(f, g, n, np.int32(above), base, size_log2)
        for probe in range(probes):
            _lookup(f, g, tex, n, (np.float32(probe) + HALF) * share - HALF)
            for i in range(n):
                f[SUM + i] += (f[MIX + i] if above == 1 else F1 - f[MIX + i]) * f[VALUE + i]
    _enlighten(f, g, light, n, light_base, nu, nv, share * light_scale)
