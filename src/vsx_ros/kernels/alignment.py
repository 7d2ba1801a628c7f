"""Whole-image alignment of small blurry images by efficient second-order minimisation (PTAM's rotation estimate)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.pose import factor_in_place, solve_factored


@kernel
def align_small(reference: Any, current: Any, iterations: int) -> tuple[float, float, float, float]:
    """Planar motion from one (h, w) float32 image to another: current(Rot(a) x + (tx, ty)) = reference(x) + mean.

    x is measured from the image centre. Returns tx, ty [small px], a [rad] and the mean squared difference reached
    over the overlap. Efficient second-order: mean of both gradients (Benhimane and Malis 2004).
    """
    height, width = reference.shape
    cx, cy = 0.5 * (width - 1), 0.5 * (height - 1)
    tx, ty, a, mean = 0.0, 0.0, 0.0, 0.0
    score = np.inf
    J = np.empty(4)
    for iteration in range(iterations + 1):
        c, s = math.cos(a), math.sin(a)
        H, b = np.zeros((4, 4)), np.zeros(4)
        squares, count = 0.0, 0
        for y in range(1, height - 1):
            for x in range(1, width - 1):
                dx, dy = x - cx, y - cy
                wx = c * dx - s * dy + tx + cx
                wy = s * dx + c * dy + ty + cy
                if not (1.0 <= wx < width - 2.0 and 1.0 <= wy < height - 2.0):
                    continue
                ix, iy = int(wx), int(wy)
                fx, fy = wx - ix, wy - iy
                i00, i10 = current[iy, ix], current[iy, ix + 1]
                i01, i11 = current[iy + 1, ix], current[iy + 1, ix + 1]
                value = (1 - fy) * ((1 - fx) * i00 + fx * i10) + fy * ((1 - fx) * i01 + fx * i11)
                gx2 = (1 - fy) * (i10 - i00) + fy * (i11 - i01)
                gy2 = (1 - fx) * (i01 - i00) + fx * (i11 - i10)
                gx = 0.5 * (gx2 + 0.5 * (reference[y, x + 1] - reference[y, x - 1]))
                gy = 0.5 * (gy2 + 0.5 * (reference[y + 1, x] - reference[y - 1, x]))
                r = value - reference[y, x] - mean
                J[0], J[1], J[3] = gx, gy, -1.0
                J[2] = gx * (-s * dx - c * dy) + gy * (c * dx - s * dy)
                for k in range(4):
                    b[k] -= J[k] * r
                    for m in range(k, 4):
                        H[k, m] += J[k] * J[m]
                squares += r * r
                count += 1
        if count < (width * height) // 4:
            return 0.0, 0.0, 0.0, np.inf
        score = squares / count
        if iteration == iterations:
            break
        for k in range(4):
            H[k, k] = H[k, k] * 1.0001 + 1e-6
        if not factor_in_place(H):
            return 0.0, 0.0, 0.0, np.inf
        solve_factored(H, b)
        tx += b[0]
        ty += b[1]
        a += b[2]
        mean += b[3]
    return tx, ty, a, score
