"""Whole-image alignment of small blurry images by efficient second-order minimisation (PTAM's rotation estimate)."""

import math

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.linalg.cholesky import factor_in_place, solve_factored

ONE = np.uint64(1)
CONVERGED_PX = 0.01
GAINS = (0.4, 2.5)  # allowed change of brightness; a negative is another image
# Factor on the mean difference at which a pixel has half weight; least such difference [grey levels]: image noise.
ROBUST, LEAST_DIFFERENCE = 1.5, 0.5


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
    reference: Float32Array, current: Float32Array, motion: FloatArray, scale: float, H: FloatArray, b: FloatArray
) -> tuple[float, float, int]:  # fmt: skip
    """Fill the normal equations H (5, 5; upper triangle), b (5,) at a motion (5,): tx, ty, a, mean, gain.

    Pixels with larger differences have less weight (Cauchy weights; with an infinite scale all are equal). Returns the
    sums of squares and of absolute differences, and the number of pixels."""
    height, width = reference.shape
    tx, ty, a, mean, gain = motion[0], motion[1], motion[2], motion[3], motion[4]
    cx, cy, c, s = 0.5 * (width - 1), 0.5 * (height - 1), math.cos(a), math.sin(a)
    h00 = h01 = h02 = h03 = h04 = h11 = h12 = h13 = h14 = h22 = h23 = h24 = h33 = h34 = h44 = 0.0
    b0 = b1 = b2 = b3 = b4 = squares = absolute = 0.0
    narrow, count = 1.0 / (scale * scale), 0
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            dx, dy, p, q = x - cx, y - cy, np.uint64(x), np.uint64(y)
            wx, wy = c * dx - s * dy + tx + cx, s * dx + c * dy + ty + cy
            if not (1.0 <= wx < width - 2.0 and 1.0 <= wy < height - 2.0):
                continue
            value, gx2, gy2 = _sample(current, wx, wy)
            level = reference[q, p]
            gx = 0.5 * (gx2 + 0.5 * gain * (reference[q, p + ONE] - reference[q, p - ONE]))
            gy = 0.5 * (gy2 + 0.5 * gain * (reference[q + ONE, p] - reference[q - ONE, p]))
            ga = gx * (-s * dx - c * dy) + gy * (c * dx - s * dy)
            r = value - gain * level - mean
            w = 1.0 / (1.0 + r * r * narrow)
            wgx, wgy, wga, wr, wl = w * gx, w * gy, w * ga, w * r, w * level
            h00 += wgx * gx
            h01 += wgx * gy
            h02 += wgx * ga
            h03 -= wgx
            h04 -= wgx * level
            h11 += wgy * gy
            h12 += wgy * ga
            h13 -= wgy
            h14 -= wgy * level
            h22 += wga * ga
            h23 -= wga
            h24 -= wga * level
            h33 += w
            h34 += wl
            h44 += wl * level
            b0 -= wr * gx
            b1 -= wr * gy
            b2 -= wr * ga
            b3 += wr
            b4 += wr * level
            squares += r * r
            absolute += abs(r)
            count += 1
    H[0, 0], H[0, 1], H[0, 2], H[0, 3], H[0, 4] = h00, h01, h02, h03, h04
    H[1, 1], H[1, 2], H[1, 3], H[1, 4] = h11, h12, h13, h14
    H[2, 2], H[2, 3], H[2, 4], H[3, 3], H[3, 4], H[4, 4] = h22, h23, h24, h33, h34, h44
    b[0], b[1], b[2], b[3], b[4] = b0, b1, b2, b3, b4
    return squares, absolute, count


@kernel
def align_small(reference: Float32Array, current: Float32Array, iterations: int) -> tuple[float, float, float, float]:
    """Planar motion from one (h, w) float32 image to another: current(Rot(a) x + (tx, ty)) = gain reference(x) + mean.

    x is measured from the image centre. At most ``iterations`` steps. Returns tx, ty [small px], a [rad] and the mean
    squared difference over the overlap (before a last step below 0.01 px). Efficient second-order: mean of both
    gradients (Benhimane and Malis 2004). Other moving things and reflections count little: pixels with more than the
    usual difference (mean of the step before) get less weight."""
    height, width = reference.shape
    motion, step, H = np.zeros(5), np.zeros(5), np.zeros((5, 5))
    motion[4], score, scale = 1.0, np.inf, np.inf
    for iteration in range(iterations + 1):
        squares, absolute, count = _linearise(reference, current, motion, scale, H, step)
        if count < (width * height) // 4:
            return 0.0, 0.0, 0.0, np.inf
        score, scale = squares / count, max(ROBUST * absolute / count, LEAST_DIFFERENCE)
        if iteration == iterations:
            break
        for k in range(5):
            H[k, k] = H[k, k] * 1.0001 + 1e-6
        if not factor_in_place(H):
            return 0.0, 0.0, 0.0, np.inf
        solve_factored(H, step)
        for k in range(5):
            motion[k] += step[k]
        motion[4] = min(max(motion[4], GAINS[0]), GAINS[1])
        if abs(step[0]) + abs(step[1]) + width * abs(step[2]) < CONVERGED_PX:
            break
    return motion[0], motion[1], motion[2], score
