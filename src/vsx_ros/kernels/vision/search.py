"""Patches of a keyframe as another camera would see them, and where a frame shows them."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
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
def warp_template(patch: NDArray[np.uint8], offset: FloatArray, w: FloatArray, template: Int32Array) -> bool:
    """Fill the (10, 10) int32 template, in 1/16 grey levels, from the (24, 24) patch; w (4,): template px -> patch px,
    offset (2,).

    Template pixel (5, 5) is the point. False when a corner of the template lies outside the patch.
    """
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


@kernel
def search(
    target: Target, templates: Int32Array, wanted: BoolArray, level: IntArray, uv: FloatArray, radius_px: float,
    reach: int,
) -> tuple[BoolArray, FloatArray]:  # fmt: skip
    """Find warped map-point patches near their predictions (level-0 px): at corners within radius_px, or, where none
    fits, at any pixel within ``reach`` level px (0: corners only).

    templates (S, 10, 10): see ``warp_templates``; wanted (S,): which to look for; level (S,), uv (S, 2) as
    ``predict`` returns them.
    Returns found (S,) bool and position (S, 2) level-0 px, sub-pixel.
    """
    n = templates.shape[0]
    found = np.zeros(n, np.bool_)
    position = np.zeros((n, 2))
    core = np.empty(64, np.int32)
    for s in range(n):
        if not wanted[s]:
            continue
        lv, template = level[s], templates[s]
        energy = quantize(template, core)
        scale = 2.0**lv
        x = (uv[s, 0] + 0.5) / scale - 0.5
        y = (uv[s, 1] + 0.5) / scale - 0.5
        best, winner = best_corner(target, lv, x, y, max(1.5, radius_px / scale), core)
        limit = MAX_SHARE * energy + NOISE_FLOOR
        if winner >= 0 and best < limit:
            px, py = target.corners[winner, 0], target.corners[winner, 1]
        elif reach > 0:
            best, dx, dy = best_pixel(target, lv, x, y, reach, core)
            if best >= limit:
                continue
            px, py = np.int32(dx), np.int32(dy)
        else:
            continue
        ok, fx, fy, rest = refine(target.pixels, target.table[lv], template, float(px), float(py))
        if ok and rest < MAX_ALIGNED_SHARE * energy + NOISE_FLOOR:
            found[s] = True
            position[s, 0] = (fx + 0.5) * scale - 0.5
            position[s, 1] = (fy + 0.5) * scale - 0.5
    return found, position
