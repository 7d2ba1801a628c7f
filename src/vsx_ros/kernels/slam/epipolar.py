"""Search of a patch along its viewing ray in another image, through the distorted camera model."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry.projection import project_normalized
from vsx_ros.kernels.vision.patches import (
    MAX_ALIGNED_SHARE,
    MAX_SHARE,
    NOISE_FLOOR,
    TEMPLATE,
    Target,
    best_corner,
    quantize,
    refine,
)
from vsx_ros.kernels.vision.search import warp_template

STEP_PX = 2.5
REACH_PX = 2.2
DISTINCT_PX = 4.0
DISTINCTION = 1.25
MAX_STEPS = 600


@kernel
def _at_inverse_depth(
    camera: FloatArray, R: FloatArray, t: FloatArray, x: float, y: float, basis: FloatArray, rho: float, A: FloatArray
) -> tuple[bool, float, float]:
    """(visible, u, v) of the ray point (x, y, 1) / rho in the target, with the warp A (4,) source px -> level-0 px."""
    X = R[0, 0] * x + R[0, 1] * y + R[0, 2] + t[0] * rho
    Y = R[1, 0] * x + R[1, 1] * y + R[1, 2] + t[1] * rho
    Z = R[2, 0] * x + R[2, 1] * y + R[2, 2] + t[2] * rho
    if Z < 0.05:
        return False, 0.0, 0.0
    a, b = X / Z, Y / Z
    if a * a + b * b > camera[9]:
        return False, 0.0, 0.0
    u, v = project_normalized(camera, a, b)
    for step in range(2):
        bx, by = basis[2 * step], basis[2 * step + 1]
        z = Z + R[2, 0] * bx + R[2, 1] * by
        if z < 0.05:
            return False, 0.0, 0.0
        uu, vv = project_normalized(
            camera, (X + R[0, 0] * bx + R[0, 1] * by) / z, (Y + R[1, 0] * bx + R[1, 1] * by) / z
        )
        A[step] = uu - u
        A[2 + step] = vv - v
    return True, u, v


@kernel
def search_rays(
    camera: FloatArray, R: FloatArray, t: FloatArray, rays: FloatArray, basis: FloatArray, patches: NDArray[np.uint8],
    inverse_depth: FloatArray, target: Target,
) -> tuple[BoolArray, FloatArray, IntArray]:  # fmt: skip
    """Find source patches in a target image somewhere along their rays.

    R, t: T_target_source. rays (C, 2): on the plane z = 1 of the source; basis (C, 4) as in ``predict``; patches
    (C, 24, 24); inverse_depth (C, 2): (far, near) bounds [1/m]. The image is walked in steps of 2.5 level px; the
    patch is warped again whenever its scale changed by 12 %. A match must be 1.25 times better than any other corner
    at least 4 level px away.
    Returns found (C,) bool, position (C, 2) level-0 px, level (C,).
    """
    n = rays.shape[0]
    found = np.zeros(n, np.bool_)
    position = np.zeros((n, 2))
    level = np.zeros(n, np.int64)
    template = np.empty((TEMPLATE, TEMPLATE), np.int32)
    chosen = np.empty((TEMPLATE, TEMPLATE), np.int32)
    core = np.empty(64, np.int32)
    centred = np.zeros(2)
    A, B, w = np.empty(4), np.empty(4), np.empty(4)
    for c in range(n):
        far, near = inverse_depth[c, 0], inverse_depth[c, 1]
        rho = far
        best, second = np.inf, np.inf
        winner, winner_level = -1, 0
        energy, limit = 0.0, 0.0
        last_det, last_level = -1.0, -1
        contrast = 0.0
        usable = False
        for _ in range(MAX_STEPS):
            if rho > near:
                break
            ok, u, v = _at_inverse_depth(camera, R, t, rays[c, 0], rays[c, 1], basis[c], rho, A)
            delta = 0.01 * (near - far)
            ok2, u2, v2 = _at_inverse_depth(camera, R, t, rays[c, 0], rays[c, 1], basis[c], rho + delta, B)
            if not ok or not ok2:
                rho += delta
                continue
            det = A[0] * A[3] - A[1] * A[2]
            lv = 0
            while det > 3.0 and lv < 3:
                det *= 0.25
                lv += 1
            scale = 2.0**lv
            speed = np.sqrt((u2 - u) * (u2 - u) + (v2 - v) * (v2 - v)) / delta
            rho += min(max(delta * 0.05, STEP_PX * scale / max(speed, 1e-9)), near - far + 1e-12)
            if not (0.25 <= det <= 3.0) or u < 0 or v < 0 or u > camera[10] - 1 or v > camera[11] - 1:
                continue
            if lv != last_level or det > 1.12 * last_det or det < last_det / 1.12:
                full = det * scale * scale
                w[0], w[1] = A[3] / full * scale, -A[1] / full * scale
                w[2], w[3] = -A[2] / full * scale, A[0] / full * scale
                last_det, last_level = det, lv
                usable = warp_template(patches[c], centred, w, template)
                if usable:
                    contrast = quantize(template, core)
            if not usable:
                continue
            score, k = best_corner(target, lv, (u + 0.5) / scale - 0.5, (v + 0.5) / scale - 0.5, REACH_PX, core)
            if k < 0:
                continue
            apart = True
            if winner >= 0 and winner_level == lv:
                dx = abs(target.corners[k, 0] - target.corners[winner, 0])
                dy = abs(target.corners[k, 1] - target.corners[winner, 1])
                apart = max(dx, dy) >= DISTINCT_PX
            if score < best:
                if apart:
                    second = best
                best, winner, winner_level = score, k, lv
                energy = contrast
                limit = MAX_SHARE * energy + NOISE_FLOOR
                chosen[:] = template
            elif apart and score < second:
                second = score
        if winner < 0 or best > limit or second < DISTINCTION * best:
            continue
        px, py = float(target.corners[winner, 0]), float(target.corners[winner, 1])
        ok, x, y, rest = refine(target.pixels, target.table[winner_level], chosen, px, py)
        if ok and rest < MAX_ALIGNED_SHARE * energy + NOISE_FLOOR:
            scale = 2.0**winner_level
            found[c] = True
            position[c, 0] = (x + 0.5) * scale - 0.5
            position[c, 1] = (y + 0.5) * scale - 0.5
            level[c] = winner_level
    return found, position, level
