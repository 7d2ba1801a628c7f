"""Where a frame shows the patches that a map predicts in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.vision.patches import (
    MAX_ALIGNED_SHARE,
    MAX_SHARE,
    NOISE_FLOOR,
    best_corner,
    best_pixel,
    quantize,
    refine,
)


@kernel
def search(
    pixels: NDArray[np.uint8],
    table: IntArray,
    corners: Int32Array,
    row_table: IntArray,
    templates: Int32Array,
    wanted: BoolArray,
    level: IntArray,
    uv: FloatArray,
    radius_px: float,
    reach: int,
) -> tuple[BoolArray, FloatArray]:
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
        radius = max(1.5, radius_px / scale)
        best, winner = best_corner(pixels, table, corners, row_table, lv, x, y, radius, core)
        limit = MAX_SHARE * energy + NOISE_FLOOR
        if winner >= 0 and best < limit:
            px, py = corners[winner, 0], corners[winner, 1]
        elif reach > 0:
            best, dx, dy = best_pixel(pixels, table, lv, x, y, reach, core)
            if best >= limit:
                continue
            px, py = np.int32(dx), np.int32(dy)
        else:
            continue
        ok, fx, fy, rest = refine(pixels, table[lv, 0], table[lv, 1], table[lv, 2], template, float(px), float(py), 10)
        if ok and rest < MAX_ALIGNED_SHARE * energy + NOISE_FLOOR:
            found[s] = True
            position[s, 0] = (fx + 0.5) * scale - 0.5
            position[s, 1] = (fy + 0.5) * scale - 0.5
    return found, position
