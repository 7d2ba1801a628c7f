"""Tile-binned ray caster for textured quads: the emulated camera's picture before the sensor.

A quad P + u U + v V (0 <= u, v <= 1) seen along the ray d (camera frame, z = 1) is hit at
u = a/c, v = b/c, inverse depth c, where (a, b, c) = M d: three linear forms per quad and pose (Moeller and
Trumbore's solution written as a matrix). Being linear, their extremes over a rectangle of rays sit at its corners, which
makes culling exact, and their value varies linearly between the two poses that bound a row of tiles, which gives
the rolling shutter. A tile hands (pixel, weight) lists, one per quad, to ``_shade``, whose loops run over flat
scratch memory with constant offsets so that they compile to vector instructions.

Texels are packed: a uint32 holds the 2x2 neighbourhood of a texel, so that one load feeds a bilinear lookup.
"""

from __future__ import annotations

import numpy as np

from vsx_ros.kernels import kernel

TILE = 16
N = TILE * TILE
RING = TILE + 2
MAX_PROBES = 8

# Rows of the float scratch memory, each N long.
RX, RY, DXX, DXY, DYX, DYY, ROW, WEIGHT = 0, N, 2 * N, 3 * N, 4 * N, 5 * N, 6 * N, 7 * N
TU, TV, MU, MV, LOD, SUM, LIGHT, FX = 8 * N, 9 * N, 10 * N, 11 * N, 12 * N, 13 * N, 14 * N, 15 * N
FY, SCALE, MIX, VALUE, LU, LV = 16 * N, 17 * N, 18 * N, 19 * N, 20 * N, 21 * N
FLOAT_ROWS = 22
# Rows of the integer scratch memory.
PIXEL, INDEX, SHIFT, BASE, TEXEL = 0, N, 2 * N, 3 * N, 4 * N
INT_ROWS = 5

F0 = np.float32(0.0)
F1 = np.float32(1.0)
HALF = np.float32(0.5)
EPS = np.float32(1e-5)
TINY = np.float32(1e-12)
NEAR = np.float32(1e-4)
LOG2_SCALE = np.float32(1.0 / (1 << 23))
LOG2_BIAS = np.float32(127.0)
THIRD = np.float32(1.0 / 3.0)
BYTE = np.int32(255)


@kernel
def plane_forms(P, U, V, two_sided, R, t, forms, visible):
    """Fill forms (S, B, Q, 9) with the three linear forms of each quad and visible (Q,) with whether it faces the camera.

    P, U, V: (Q, 3) corner and edges [m]. R (S, B, 3, 3), t (S, B, 3): camera poses (T_world_cam) of sub-frame s
    at tile-row border b. A one-sided quad faces the camera when U x V points away from it (u right, v down), at every pose.
    """
    for q in range(P.shape[0]):
        nx = U[q, 1] * V[q, 2] - U[q, 2] * V[q, 1]
        ny = U[q, 2] * V[q, 0] - U[q, 0] * V[q, 2]
        nz = U[q, 0] * V[q, 1] - U[q, 1] * V[q, 0]
        limit = 1e-6 * np.sqrt(nx * nx + ny * ny + nz * nz)
        front = True
        back = True
        for s in range(R.shape[0]):
            for b in range(R.shape[1]):
                tx, ty, tz = t[s, b, 0] - P[q, 0], t[s, b, 1] - P[q, 1], t[s, b, 2] - P[q, 2]
                height = nx * tx + ny * ty + nz * tz
                front = front and height < -limit
                back = back and height > limit
        visible[q] = front or (back and two_sided[q])
        if not visible[q]:
            continue
        for s in range(R.shape[0]):
            for b in range(R.shape[1]):
                tx, ty, tz = t[s, b, 0] - P[q, 0], t[s, b, 1] - P[q, 1], t[s, b, 2] - P[q, 2]
                k = -1.0 / (nx * tx + ny * ty + nz * tz)
                ax = (ty * V[q, 2] - tz * V[q, 1]) * k
                ay = (tz * V[q, 0] - tx * V[q, 2]) * k
                az = (tx * V[q, 1] - ty * V[q, 0]) * k
                bx = (U[q, 1] * tz - U[q, 2] * ty) * k
                by = (U[q, 2] * tx - U[q, 0] * tz) * k
                bz = (U[q, 0] * ty - U[q, 1] * tx) * k
                for j in range(3):
                    r0, r1, r2 = R[s, b, 0, j], R[s, b, 1, j], R[s, b, 2, j]
                    forms[s, b, q, j] = ax * r0 + ay * r1 + az * r2
                    forms[s, b, q, 3 + j] = bx * r0 + by * r1 + bz * r2
                    forms[s, b, q, 6 + j] = (nx * r0 + ny * r1 + nz * r2) * k


@kernel
def _lowest(e0, e1, e2, x0, x1, y0, y1):
    """Minimum of e0 x + e1 y + e2 over a rectangle."""
    return e2 + (e0 * x0 if e0 > 0.0 else e0 * x1) + (e1 * y0 if e1 > 0.0 else e1 * y1)


@kernel
def _overlap(forms, b, q, x0, x1, y0, y1):
    """0: no ray of the rectangle can hit the quad; 1: some may; 2: all do. Over both borders and outer sub-frames."""
    last = forms.shape[0] - 1
    out0 = out1 = out2 = out3 = out4 = True
    full = True
    for s in range(0, last + 1, max(last, 1)):
        for border in range(b, b + 2):
            m = forms[s, border, q]
            a0, a1, a2, b0, b1, b2, c0, c1, c2 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]
            out0 = out0 and -_lowest(-a0, -a1, -a2, x0, x1, y0, y1) < 0.0
            out1 = out1 and -_lowest(a0 - c0, a1 - c1, a2 - c2, x0, x1, y0, y1) < 0.0
            out2 = out2 and -_lowest(-b0, -b1, -b2, x0, x1, y0, y1) < 0.0
            out3 = out3 and -_lowest(b0 - c0, b1 - c1, b2 - c2, x0, x1, y0, y1) < 0.0
            out4 = out4 and -_lowest(-c0, -c1, -c2, x0, x1, y0, y1) <= 0.0
            if out0 or out1 or out2 or out3 or out4:
                full = False
            elif full:
                full = (
                    _lowest(a0, a1, a2, x0, x1, y0, y1) >= 0.0
                    and _lowest(c0 - a0, c1 - a1, c2 - a2, x0, x1, y0, y1) >= 0.0
                    and _lowest(b0, b1, b2, x0, x1, y0, y1) >= 0.0
                    and _lowest(c0 - b0, c1 - b1, c2 - b2, x0, x1, y0, y1) >= 0.0
                    and _lowest(c0, c1, c2, x0, x1, y0, y1) > 0.0
                )
    if out0 or out1 or out2 or out3 or out4:
        return 0
    return 2 if full else 1


@kernel
def _hides(forms, b, q, r, x0, x1, y0, y1):
    """Whether quad q, known to cover the rectangle, is in front of quad r on every ray of it."""
    last = forms.shape[0] - 1
    for s in range(0, last + 1, max(last, 1)):
        for border in range(b, b + 2):
            m, o = forms[s, border, q], forms[s, border, r]
            if _lowest(m[6] - o[6], m[7] - o[7], m[8] - o[8], x0, x1, y0, y1) < 0.0:
                return False
    return True


@kernel
def _candidates(forms, b, pool, n_pool, rect, found, cover):
    """Put the quads of pool that may be seen inside rect into found; return their number and whether one covers alone."""
    x0, x1, y0, y1 = rect[0], rect[1], rect[2], rect[3]
    n = 0
    for i in range(n_pool):
        kind = _overlap(forms, b, pool[i], x0, x1, y0, y1)
        if kind > 0:
            found[n] = pool[i]
            cover[n] = kind == 2
            n += 1
    for i in range(n):
        if not cover[i]:
            continue
        for j in range(n):
            if j != i and found[j] >= 0 and found[i] >= 0 and _hides(forms, b, found[i], found[j], x0, x1, y0, y1):
                found[j] = -1
    kept = 0
    alone = False
    for i in range(n):
        if found[i] >= 0:
            found[kept] = found[i]
            alone = cover[i]
            kept += 1
    return kept, alone and kept == 1


@kernel
def _tile_forms(forms, s, b, quads, n, m):
    """m (n, 18) float32: forms at the upper border and their change to the lower one."""
    for k in range(n):
        for j in range(9):
            top = forms[s, b, quads[k], j]
            m[k, j] = np.float32(top)
            m[k, 9 + j] = np.float32(forms[s, b + 1, quads[k], j] - top)


@kernel
def _visibility(m, n, rx, ry, y0, x0, nearest, winner):
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
def _edge_weights(m, n, rx, ry, y, x, row, weights):
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
def _enter(f, g, i, rx, ry, y, x, ratio, weight, width):
    """Append pixel (y, x) to the shading list at place i."""
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
def _footprint(f, n, m, k, su, sv, ou, ov, lu, lv):
    """Texture coordinates and the axes of the pixel's footprint, in texels of the finest level.

    Leaves TU, TV, LU, LV, the major axis (MU, MV), its length in LOD and the minor length in MIX; returns the largest
    ratio of the axes and the largest major axis.
    """
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
def _lookup(f, g, tex, n, shift_u, shift_v, probe):
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
        t = g[TEXEL + i]
        t00 = np.float32(t & BYTE)
        t01 = np.float32((t >> np.int32(8)) & BYTE)
        t10 = np.float32((t >> np.int32(16)) & BYTE)
        t11 = np.float32((t >> np.int32(24)) & BYTE)
        fx = f[FX + i]
        upper = t00 + fx * (t01 - t00)
        lower = t10 + fx * (t11 - t10)
        f[VALUE + i] = upper + f[FY + i] * (lower - upper)


@kernel
def _level(f, g, n, above, base, size_log2):
    """SCALE, SHIFT and BASE of the mip level floor(LOD) + above, at most the coarsest."""
    whole = np.int32(1) << size_log2
    area = np.int32(4) * whole * whole
    for i in range(n):
        level = min(np.int32(f[LOD + i]) + above, size_log2)
        shift = size_log2 - level
        size = np.int32(1) << shift
        g[SHIFT + i] = shift
        f[SCALE + i] = np.float32(size) / np.float32(whole)
        # The finer levels hold (4 whole^2 - 4 size^2) / 3 texels together.
        g[BASE + i] = base + (area - np.int32(4) * size * size) // np.int32(3)


@kernel
def _shade(f, bits, g, n, tex, light, m, k, surface, place):
    """Fill SUM with the radiance of the n listed pixels on quad k: texture (anisotropic, trilinear) times light."""
    su, sv, ou, ov, light_scale = surface[0], surface[1], surface[2], surface[3], surface[4]
    base, size_log2, light_base, nu, nv = place[0], place[1], place[2], place[3], place[4]
    lu, lv = np.float32(nu - 1), np.float32(nv - 1)
    widest, longest = _footprint(f, n, m, k, su, sv, ou, ov, lu, lv)
    probes = max(1, min(MAX_PROBES, int(min(widest, np.float32(64.0)) + HALF)))
    probes = max(1, min(probes, int(min(longest, np.float32(64.0)) + F1)))
    share = F1 / np.float32(probes)
    for i in range(n):
        f[LOD + i] = max(max(f[MIX + i], f[LOD + i] * share), F1)
    finest = True
    for i in range(n):
        # log2 from the bits of the float: piecewise linear, off by at most 0.09 levels, and continuous.
        lod = np.float32(bits[LOD + i]) * LOG2_SCALE - LOG2_BIAS
        lod = max(lod, F0)
        f[LOD + i] = lod
        f[MIX + i] = lod - np.floor(lod)
        f[SUM + i] = F0
    for i in range(n):
        finest = finest and f[LOD + i] <= F0
    _level(f, g, n, np.int32(0), base, size_log2)
    for probe in range(probes):
        at = (np.float32(probe) + HALF) * share - HALF
        _lookup(f, g, tex, n, su, sv, at)
        for i in range(n):
            f[SUM + i] += (F1 - f[MIX + i]) * f[VALUE + i]
    if not finest:
        _level(f, g, n, np.int32(1), base, size_log2)
        for probe in range(probes):
            at = (np.float32(probe) + HALF) * share - HALF
            _lookup(f, g, tex, n, su, sv, at)
            for i in range(n):
                f[SUM + i] += f[MIX + i] * f[VALUE + i]
    top_u, top_v = nu - np.int32(2), nv - np.int32(2)
    for i in range(n):
        column = min(np.int32(f[LU + i]), top_u)
        row = min(np.int32(f[LV + i]), top_v)
        f[FX + i] = f[LU + i] - np.float32(column)
        f[FY + i] = f[LV + i] - np.float32(row)
        g[INDEX + i] = light_base + row * nu + column
    for i in range(n):
        g[TEXEL + i] = light[np.uint32(g[INDEX + i])]
    for i in range(n):
        t = g[TEXEL + i]
        t00 = np.float32(t & BYTE)
        t01 = np.float32((t >> np.int32(8)) & BYTE)
        t10 = np.float32((t >> np.int32(16)) & BYTE)
        t11 = np.float32((t >> np.int32(24)) & BYTE)
        upper = t00 + f[FX + i] * (t01 - t00)
        lower = t10 + f[FX + i] * (t11 - t10)
        f[SUM + i] *= share * light_scale * (upper + f[FY + i] * (lower - upper))


@kernel
def _spread(f, g, n, tint, bayer, width, share, picture):
    """Add SUM, tinted for the colour each pixel sees, to the picture (flat)."""
    for i in range(n):
        at = g[PIXEL + i]
        colour = 3
        if bayer:
            # GRBG: even rows green, red; odd rows blue, green.
            odd_row, odd_column = (at // width) & 1, (at % width) & 1
            colour = 1 if odd_row == odd_column else (0 if odd_row == 0 else 2)
        picture[at] += share * f[WEIGHT + i] * tint[colour] * f[SUM + i]


@kernel
def render_tile_rows(
    first, last, forms, pool, n_pool, bounds, rx, ry, tex, light, surfaces, places, tints, bayer, picture, depth, ident
):
    """Render the rows of tiles first <= row < last into picture (H, W) float32, in units of full-scale reflectance * light.

    forms: (S, B, Q, 9) of ``plane_forms``. pool: (>= n_pool,) visible quads. bounds: (rows, columns, 4) least and greatest
    rx, least and greatest ry of a tile with its ring. rx, ry: (H + 3, W + 3) rays, pixel (y, x) at [y + 1, x + 1], padded
    to whole tiles. tex, light: packed texels (int32). surfaces (Q, 5) float32: texels along U, V, offsets, light scale.
    places (Q, 5) int32: texture base, log2 of its size, light base, light nodes along U and V. tints (Q, 4): r, g, b, grey.
    picture must be zero. depth (H, W) [m] and ident (H, W) take the pixel centre's values of the first sub-frame; pass
    arrays of size 0 to skip them.
    """
    height, width = picture.shape
    flat = picture.reshape(height * width)
    f = np.zeros(FLOAT_ROWS * N, dtype=np.float32)
    bits = f.view(np.int32)
    g = np.zeros(INT_ROWS * N, dtype=np.int32)
    strip = np.empty(n_pool + 1, dtype=np.int64)
    found = np.empty(n_pool + 1, dtype=np.int64)
    cover = np.empty(n_pool + 1, dtype=np.bool_)
    m = np.empty((n_pool + 1, 18), dtype=np.float32)
    weights = np.empty(n_pool + 1, dtype=np.float32)
    nearest = np.empty(RING * RING, dtype=np.float32)
    winner = np.empty(RING * RING, dtype=np.int32)
    edge_at = np.empty(N, dtype=np.int32)
    edge_weight = np.empty((n_pool + 1, N), dtype=np.float32)
    rect = np.empty(4)
    sub_frames = forms.shape[0]
    share = F1 / np.float32(sub_frames)
    for ty in range(first, last):
        rect[0], rect[1] = bounds[ty, :, 0].min(), bounds[ty, :, 1].max()
        rect[2], rect[3] = bounds[ty, :, 2].min(), bounds[ty, :, 3].max()
        n_strip = 0
        for i in range(n_pool):
            if _overlap(forms, ty, pool[i], rect[0], rect[1], rect[2], rect[3]) > 0:
                strip[n_strip] = pool[i]
                n_strip += 1
        y0 = ty * TILE
        y1 = min(y0 + TILE, height)
        for tx in range(bounds.shape[1]):
            x0 = tx * TILE
            x1 = min(x0 + TILE, width)
            n, alone = _candidates(forms, ty, strip, n_strip, bounds[ty, tx], found, cover)
            if n == 0:
                continue
            for s in range(sub_frames):
                _tile_forms(forms, s, ty, found, n, m)
                if alone:
                    count = 0
                    for y in range(y0, y1):
                        ratio = np.float32((y - y0) / TILE)
                        for x in range(x0, x1):
                            _enter(f, g, count, rx, ry, y, x, ratio, F1, width)
                            count += 1
                    _shade(f, bits, g, count, tex, light, m, 0, surfaces[found[0]], places[found[0]])
                    _spread(f, g, count, tints[found[0]], bayer, width, share, flat)
                    if s == 0 and depth.size > 0:
                        for y in range(y0, y1):
                            ratio = np.float32((y - y0) / TILE)
                            for x in range(x0, x1):
                                c = (m[0, 6] + ratio * m[0, 15]) * rx[y + 1, x + 1]
                                c += (m[0, 7] + ratio * m[0, 16]) * ry[y + 1, x + 1] + m[0, 8] + ratio * m[0, 17]
                                depth[y, x] = F1 / c
                                ident[y, x] = found[0]
                    continue
                _visibility(m, n, rx, ry, y0, x0, nearest, winner)
                edges = 0
                for y in range(y0, y1):
                    for x in range(x0, x1):
                        at = (y - y0 + 1) * RING + x - x0 + 1
                        who = winner[at]
                        if (
                            winner[at - 1] != who
                            or winner[at + 1] != who
                            or winner[at - RING] != who
                            or winner[at + RING] != who
                        ):
                            _edge_weights(m, n, rx, ry, y, x, np.float32((y - y0) / TILE), weights)
                            edge_at[edges] = (y - y0) * TILE + x - x0
                            for k in range(n):
                                edge_weight[k, edges] = weights[k]
                            edges += 1
                        if s == 0 and depth.size > 0 and who >= 0:
                            depth[y, x] = F1 / nearest[at]
                            ident[y, x] = found[who]
                for i in range(edges):
                    winner[(edge_at[i] // TILE + 1) * RING + edge_at[i] % TILE + 1] = np.int32(-2)
                for k in range(n):
                    count = 0
                    for y in range(y0, y1):
                        ratio = np.float32((y - y0) / TILE)
                        at = (y - y0 + 1) * RING + 1
                        for x in range(x0, x1):
                            if winner[at + x - x0] == k:
                                _enter(f, g, count, rx, ry, y, x, ratio, F1, width)
                                count += 1
                    for i in range(edges):
                        if edge_weight[k, i] > F0:
                            row = edge_at[i] // TILE
                            ratio = np.float32(row / TILE)
                            x = x0 + edge_at[i] % TILE
                            _enter(f, g, count, rx, ry, y0 + row, x, ratio, edge_weight[k, i], width)
                            count += 1
                    if count > 0:
                        _shade(f, bits, g, count, tex, light, m, k, surfaces[found[k]], places[found[k]])
                        _spread(f, g, count, tints[found[k]], bayer, width, share, flat)
