"""Whole-image alignment of small blurry images by efficient second-order minimisation (PTAM's rotation estimate)."""

import math

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.linalg.cholesky import factor_in_place, solve_factored

ONE = np.uint64(1)
CONVERGED_PX = 0.01


@kernel
def _sample(image: Float32Array, x: float, y: float) -> tuple[float, float, float]:
    """Bilinear value at (x, y) and its derivatives."""
    ix, iy = int(x), int(y)
    fx, fy = x - ix, y - iy
    u, v = np.uint64(ix), np.uint64(iy)
    i00, i10 = image[v, u], image[v, u + ONE]
    i01, i11 = image[v + ONE, u], image[v + ONE, u + ONE]
    value = (1 - fy) * ((1 - fx) * i00 + fx * i10) + fy * ((1 - fx) * i01 + fx * i11)
    return value, (1 - fy) * (i10 - i00) + fy * (i11 - i01), (1 - fx) * (i01 - i00) + fx * (i11 - i10)


@kernel
def _linearise(
    reference: Float32Array, current: Float32Array, tx: float, ty: float, a: float, mean: float, H: FloatArray,
    b: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Fill the normal equations H (4, 4; upper triangle), b (4,); sum of squared differences and number of pixels."""
    height, width = reference.shape
    cx, cy, c, s = 0.5 * (width - 1), 0.5 * (height - 1), math.cos(a), math.sin(a)
    h00 = h01 = h02 = h03 = h11 = h12 = h13 = h22 = h23 = b0 = b1 = b2 = b3 = squares = 0.0
    count = 0
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            dx, dy, p, q = x - cx, y - cy, np.uint64(x), np.uint64(y)
            wx, wy = c * dx - s * dy + tx + cx, s * dx + c * dy + ty + cy
            if not (1.0 <= wx < width - 2.0 and 1.0 <= wy < height - 2.0):
                continue
            value, gx2, gy2 = _sample(current, wx, wy)
            gx = 0.5 * (gx2 + 0.5 * (reference[q, p + ONE] - reference[q, p - ONE]))
            gy = 0.5 * (gy2 + 0.5 * (reference[q + ONE, p] - reference[q - ONE, p]))
            ga = gx * (-s * dx - c * dy) + gy * (c * dx - s * dy)
            r = value - reference[q, p] - mean
            h00 += gx * gx
            h01 += gx * gy
            h02 += gx * ga
            h03 -= gx
            h11 += gy * gy
            h12 += gy * ga
            h13 -= gy
            h22 += ga * ga
            h23 -= ga
            b0 -= gx * r
            b1 -= gy * r
            b2 -= ga * r
            b3 += r
            squares += r * r
            count += 1
    H[0, 0], H[0, 1], H[0, 2], H[0, 3] = h00, h01, h02, h03
    H[1, 1], H[1, 2], H[1, 3] = h11, h12, h13
    H[2, 2], H[2, 3], H[3, 3] = h22, h23, count
    b[0], b[1], b[2], b[3] = b0, b1, b2, b3
    return squares, count


@kernel
def align_small(reference: Float32Array, current: Float32Array, iterations: int) -> tuple[float, float, float, float]:
    """Planar motion from one (h, w) float32 image to another: current(Rot(a) x + (tx, ty)) = reference(x) + mean.

    x is measured from the image centre. At most ``iterations`` steps. Returns tx, ty [small px], a [rad] and the mean
    squared difference over the overlap (but for a last step below 0.01 px). Efficient second-order: mean of both
    gradients (Benhimane and Malis 2004)."""
    height, width = reference.shape
    tx, ty, a, mean = 0.0, 0.0, 0.0, 0.0
    score = np.inf
    for iteration in range(iterations + 1):
        H, b = np.zeros((4, 4)), np.zeros(4)
        squares, count = _linearise(reference, current, tx, ty, a, mean, H, b)
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
        if abs(b[0]) + abs(b[1]) + width * abs(b[2]) < CONVERGED_PX:
            break
    return tx, ty, a, score
