"""Which textured quads a rectangle of rays may see: the culling half of the ray caster.

A quad P + u U + v V (0 <= u, v <= 1) seen along the ray d (camera frame, z = 1) is hit at u = a/c, v = b/c, inverse
depth c, where (a, b, c) = M d: three linear forms per quad and pose (Moeller and Trumbore's solution written as a
matrix). Linear forms have their extremes over a rectangle of rays at its corners, so culling is exact. Between the two
poses that bound a row of tiles they vary linearly, which gives the rolling shutter."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel


class Scene(NamedTuple):
    """Q quads. P, U, V (Q, 3): corner and edges [m]. surfaces (Q, 5): texels along U, V, offsets, light scale; places
    (Q, 5): texture base, log2 of its size, light base, light nodes along U and V; tints (Q, 4): r, g, b, grey. tex,
    light: packed texels and packed light."""

    P: FloatArray
    U: FloatArray
    V: FloatArray
    surfaces: Float32Array
    places: Int32Array
    tints: Float32Array
    tex: Int32Array
    light: Int32Array


@kernel
def plane_forms(scene: Scene, R: FloatArray, t: FloatArray) -> tuple[FloatArray, IntArray]:
    """Linear forms (S, B, Q, 9) of the quads, and which quads (K,) the camera may see; forms of others stay zero. R (S,
    B, 3, 3), t (S, B, 3): camera poses (T_world_cam) of sub-frame s at tile-row border b. A quad is seen when U x V
    points away from the camera (u right, v down), at every pose."""
    P, U, V = scene.P, scene.U, scene.V
    forms, visible = np.zeros((R.shape[0], R.shape[1], P.shape[0], 9)), np.ones(P.shape[0], np.bool_)
    for q in range(P.shape[0]):
        nx = U[q, 1] * V[q, 2] - U[q, 2] * V[q, 1]
        ny = U[q, 2] * V[q, 0] - U[q, 0] * V[q, 2]
        nz = U[q, 0] * V[q, 1] - U[q, 1] * V[q, 0]
        limit = 1e-6 * np.sqrt(nx * nx + ny * ny + nz * nz)
        for s in range(R.shape[0]):
            for b in range(R.shape[1]):
                tx, ty, tz = t[s, b, 0] - P[q, 0], t[s, b, 1] - P[q, 1], t[s, b, 2] - P[q, 2]
                height = nx * tx + ny * ty + nz * tz
                visible[q] = visible[q] and height < -limit
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
    return forms, np.flatnonzero(visible)


@kernel
def _lowest(e0: float, e1: float, e2: float, x0: float, x1: float, y0: float, y1: float) -> float:
    """Minimum of e0 x + e1 y + e2 over a rectangle."""
    lowest: float = e2 + (e0 * x0 if e0 > 0.0 else e0 * x1) + (e1 * y0 if e1 > 0.0 else e1 * y1)
    return lowest


@kernel
def overlap(forms: FloatArray, b: int, q: int, x0: float, x1: float, y0: float, y1: float) -> int:
    """0: no ray of the rectangle can hit the quad; 1: some may; 2: all do. For both borders and outer sub-frames."""
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
def _hides(forms: FloatArray, b: int, q: int, r: int, x0: float, x1: float, y0: float, y1: float) -> bool:
    """Whether quad q, known to cover the rectangle, is in front of quad r on every ray of it."""
    last = forms.shape[0] - 1
    for s in range(0, last + 1, max(last, 1)):
        for border in range(b, b + 2):
            m, o = forms[s, border, q], forms[s, border, r]
            if _lowest(m[6] - o[6], m[7] - o[7], m[8] - o[8], x0, x1, y0, y1) < 0.0:
                return False
    return True


@kernel
def candidates(
    forms: FloatArray, b: int, pool: IntArray, rect: FloatArray, found: IntArray, cover: BoolArray
) -> tuple[int, bool]:
    """Put the quads of pool that rect may see into found; return their number and whether a single one covers it."""
    x0, x1, y0, y1 = rect[0], rect[1], rect[2], rect[3]
    n = 0
    for q in pool:
        kind = overlap(forms, b, q, x0, x1, y0, y1)
        if kind > 0:
            found[n] = q
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
