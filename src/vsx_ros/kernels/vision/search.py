"""Warps patches of a keyframe to the view of another camera, and finds them in a frame."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.geometry import project_normalized, project_rows, transform
from vsx_ros.kernels.vision.patches import (
    CENTRE,
    MAX_ALIGNED_SHARE,
    MAX_SHARE,
    NOISE_FLOOR,
    PATCH,
    TEMPLATE,
    Target,
    best_corner,
    best_pixel,
    quantize,
    refine,
)


@kernel
def best_template(
    templates: IntArray, source: IntArray, source_centre: FloatArray, X: float, Y: float, Z: float, nx: float,
    ny: float, nz: float,
) -> int:  # fmt: skip
    """The one of a point's templates (V,) seen from the most similar direction and distance, at most 53 degrees away;
    -1 without. (nx, ny, nz): the point (X, Y, Z) minus the camera's centre."""
    n2 = nx * nx + ny * ny + nz * nz
    best, closest = -1, np.inf
    for slot in range(templates.shape[0]):
        candidate = templates[slot]
        if candidate < 0:
            continue
        k = source[candidate]
        sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
        s2 = sx * sx + sy * sy + sz * sz
        cosine = (sx * nx + sy * ny + sz * nz) / math.sqrt(s2 * n2)
        ratio = s2 / n2
        # The second term is log(ratio)^2 to second order.
        unlike = 2.0 * (1.0 - cosine) + 0.05 * (ratio + 1.0 / ratio - 2.0)
        if cosine > 0.6 and unlike < closest:
            best, closest = candidate, unlike
    return best


@part
def level_of(determinant: float) -> tuple[int, float]:
    """Level at which to search a patch whose warp to level-0 px has this determinant, and the determinant there: in
    [0.25, 3] if the patch can be found (PTAM's rule)."""
    level = 0
    while determinant > 3.0 and level < 3:
        determinant *= 0.25
        level += 1
    return level, determinant


@part
def inverted_warp(A: FloatArray, determinant: float, level: int) -> tuple[float, float, float, float]:
    """The warp level px -> source px, from the warp A (4,), source px -> level-0 px."""
    scale = 2.0**level
    return (
        A[3] / determinant * scale, -A[1] / determinant * scale,
        -A[2] / determinant * scale, A[0] / determinant * scale,
    )  # fmt: skip


@kernel
def predict(
    camera: FloatArray, R: FloatArray, t: FloatArray, points: FloatArray, rows: IntArray, templates: IntArray,
    source: IntArray, basis: FloatArray, source_R: FloatArray, source_centre: FloatArray, margin_px: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, IntArray]:  # fmt: skip
    """Where map points appear, at which level, which of their templates fits best and how it is warped.

    R, t: T_cam_world of the image. points (P, 3): world; rows (C,): the points to predict. templates (P, V): template
    numbers of each point, -1 for none. source (T,): the keyframe a template comes from, as row of source_R (K, 3, 3) =
    R_world_cam and source_centre (K, 3). basis (T, 4): right and down step of one source-level pixel on the plane z
    = 1 of the source camera.
    Returns of the S visible ones rows (S,), level (S,), uv (S, 2) level-0 px, inverse_warp (S, 4): level px -> source
    px, row-major, and template (S,). The level is the one where the warp's determinant lies in [0.25, 3] (PTAM's
    rule)."""
    pixels, inside = project_rows(camera, R, t, points, rows, margin_px)
    n, m = rows.shape[0], 0
    visible, level, template = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    uv, inverse_warp, A = np.empty((n, 2)), np.empty((n, 4)), np.empty(4)
    cx = -(R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2])
    cy = -(R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2])
    cz = -(R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2])
    for c in range(n):
        if not inside[c]:
            continue
        i = rows[c]
        X, Y, Z = points[i, 0], points[i, 1], points[i, 2]
        best = best_template(templates[i], source, source_centre, X, Y, Z, X - cx, Y - cy, Z - cz)
        if best < 0:
            continue
        k = source[best]
        sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
        depth = sx * source_R[k, 0, 2] + sy * source_R[k, 1, 2] + sz * source_R[k, 2, 2]
        if depth <= 0.0:
            continue
        good = True
        for step in range(2):
            bx, by = basis[best, 2 * step] * depth, basis[best, 2 * step + 1] * depth
            wx = X + source_R[k, 0, 0] * bx + source_R[k, 0, 1] * by
            wy = Y + source_R[k, 1, 0] * bx + source_R[k, 1, 1] * by
            wz = Z + source_R[k, 2, 0] * bx + source_R[k, 2, 1] * by
            x, y, z = transform(R, t, wx, wy, wz)
            if z < 1e-3:
                good = False
                break
            u, v = project_normalized(camera, x / z, y / z)
            A[step], A[2 + step] = u - pixels[c, 0], v - pixels[c, 1]
        determinant = A[0] * A[3] - A[1] * A[2]
        chosen, left = level_of(determinant)
        if not good or not 0.25 <= left <= 3.0:
            continue
        visible[m], level[m], template[m] = i, chosen, best
        uv[m, 0], uv[m, 1] = pixels[c, 0], pixels[c, 1]
        w = inverted_warp(A, determinant, chosen)
        inverse_warp[m, 0], inverse_warp[m, 1], inverse_warp[m, 2], inverse_warp[m, 3] = w
        m += 1
    return visible[:m], level[:m], uv[:m], inverse_warp[:m], template[:m]


@kernel
def warp_template(patch: NDArray[np.uint8], offset: FloatArray, w: FloatArray, template: Int32Array) -> bool:
    """Fill the (10, 10) int32 template, in 1/16 grey levels, from the (24, 24) patch; w (4,): template px -> patch px,
    offset (2,).

    Template pixel (5, 5) is the point. False when a corner of the template lies outside the patch."""
    x0 = CENTRE + offset[0] - 5.0 * (w[0] + w[1])
    y0 = CENTRE + offset[1] - 5.0 * (w[2] + w[3])
    for corner in range(4):
        i, j = 9.0 * (corner & 1), 9.0 * (corner >> 1)
        px = x0 + w[0] * i + w[1] * j
        py = y0 + w[2] * i + w[3] * j
        # The margin is more than the rounding of the fixed-point steps below.
        if not (1e-3 <= px < PATCH - 1.001 and 1e-3 <= py < PATCH - 1.001):
            return False
    X, Y = int(x0 * 65536.0), int(y0 * 65536.0)
    a, b, c, d = int(w[0] * 65536.0), int(w[1] * 65536.0), int(w[2] * 65536.0), int(w[3] * 65536.0)
    one = np.uint64(1)
    for j in range(TEMPLATE):
        for i in range(TEMPLATE):
            px = X + a * i + b * j
            py = Y + c * i + d * j
            x, y = np.uint64(px >> 16), np.uint64(py >> 16)
            fx, fy = (px >> 6) & 1023, (py >> 6) & 1023
            top = (1024 - fx) * np.int64(patch[y, x]) + fx * np.int64(patch[y, x + one])
            bottom = (1024 - fx) * np.int64(patch[y + one, x]) + fx * np.int64(patch[y + one, x + one])
            template[j, i] = ((1024 - fy) * top + fy * bottom + 32768) >> 16
    return True


@kernel
def warp_templates(
    patches: NDArray[np.uint8], offsets: FloatArray, chosen: IntArray, inverse_warp: FloatArray
) -> tuple[Int32Array, BoolArray]:
    """Templates (S, 10, 10) int32 of the chosen (S,) patches (T, 24, 24) with offsets (T, 2), warped by inverse_warp
    (S, 4) as ``predict`` returns it; usable (S,)."""
    n = chosen.shape[0]
    templates = np.empty((n, TEMPLATE, TEMPLATE), np.int32)
    usable = np.empty(n, np.bool_)
    for s in range(n):
        usable[s] = warp_template(patches[chosen[s]], offsets[chosen[s]], inverse_warp[s], templates[s])
    return templates, usable


@part
def aligned(
    target: Target, level: int, template: Int32Array, core: Int32Array, contrast: float, x: float, y: float
) -> tuple[bool, float, float]:
    """(found, x, y [level-0 px], 0 where not found) of a template near a place [level px]. core, contrast: see
    ``quantize``."""
    ok, x, y, rest = refine(target.pixels, target.table[level], template, core, contrast, x, y)
    if not (ok and rest < MAX_ALIGNED_SHARE * contrast + NOISE_FLOOR):
        return False, 0.0, 0.0
    scale = 2.0**level
    return True, (x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5


@kernel
def search(
    target: Target, templates: Int32Array, wanted: BoolArray, level: IntArray, uv: FloatArray, radius_px: float,
    reach: int,
) -> tuple[BoolArray, FloatArray]:  # fmt: skip
    """Find warped map-point patches near their predictions (level-0 px): at corners within radius_px, or, where none
    fits, at any pixel within ``reach`` level px (0: corners only).

    templates (S, 10, 10): see ``warp_templates``; wanted (S,): which to look for; level (S,), uv (S, 2) as
    ``predict`` returns them.
    Returns found (S,) bool and position (S, 2) level-0 px, sub-pixel."""
    n = templates.shape[0]
    found = np.zeros(n, np.bool_)
    position = np.zeros((n, 2))
    core = np.empty(64, np.int32)
    for s in range(n):
        if not wanted[s]:
            continue
        lv, template = level[s], templates[s]
        contrast = quantize(template, core)
        scale = 2.0**lv
        x = (uv[s, 0] + 0.5) / scale - 0.5
        y = (uv[s, 1] + 0.5) / scale - 0.5
        best, winner = best_corner(target, lv, x, y, max(1.5, radius_px / scale), core, contrast)
        limit = MAX_SHARE * contrast + NOISE_FLOOR
        if winner >= 0 and best < limit:
            px, py = target.corners[winner, 0], target.corners[winner, 1]
        elif reach > 0:
            best, dx, dy = best_pixel(target, lv, x, y, reach, core, contrast)
            if best >= limit:
                continue
            px, py = np.int32(dx), np.int32(dy)
        else:
            continue
        found[s], position[s, 0], position[s, 1] = aligned(target, lv, template, core, contrast, float(px), float(py))
    return found, position
