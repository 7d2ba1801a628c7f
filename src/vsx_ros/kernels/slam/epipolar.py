"""Search of a patch along its viewing ray in another image, through the distorted camera model."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry import project_normalized
from vsx_ros.kernels.lens import HEIGHT, PLANE_R2, WIDTH
from vsx_ros.kernels.vision.patches import MAX_SHARE, NOISE_FLOOR, TEMPLATE, Target, best_corner, quantize
from vsx_ros.kernels.vision.search import aligned, inverted_warp, level_of, warp_template

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
    if a * a + b * b > camera[PLANE_R2]:
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


class Memory(NamedTuple):
    """Memory of a search: the last warped template (10, 10), its core (64,), zero offset (2,), and three warps (4,)."""

    warped: Int32Array
    core: Int32Array
    centred: FloatArray
    A: FloatArray
    B: FloatArray
    w: FloatArray


@kernel
def _search_ray(
    camera: FloatArray, R: FloatArray, t: FloatArray, ray: FloatArray, basis: FloatArray, patch: NDArray[np.uint8],
    far: float, near: float, target: Target, template: Int32Array, memory: Memory,
) -> tuple[int, int]:  # fmt: skip
    """(corner, level) where a patch is found along its ray between two inverse depths, corner -1 if not found or not
    distinct; fills template (10, 10)."""
    warped, core, centred, A, B, w = memory
    best, second, winner, winner_level = np.inf, np.inf, -1, 0
    energy, contrast, last_left, last_level, usable = 0.0, 0.0, -1.0, -1, False
    rho, delta = far, 0.01 * (near - far)
    for _ in range(MAX_STEPS):
        if rho > near:
            break
        ok, u, v = _at_inverse_depth(camera, R, t, ray[0], ray[1], basis, rho, A)
        ok2, u2, v2 = _at_inverse_depth(camera, R, t, ray[0], ray[1], basis, rho + delta, B)
        if not ok or not ok2:
            rho += delta
            continue
        determinant = A[0] * A[3] - A[1] * A[2]
        level, left = level_of(determinant)
        scale = 2.0**level
        speed = np.sqrt((u2 - u) * (u2 - u) + (v2 - v) * (v2 - v)) / delta
        rho += min(max(delta * 0.05, STEP_PX * scale / max(speed, 1e-9)), near - far + 1e-12)
        if not 0.25 <= left <= 3.0 or u < 0 or v < 0 or u > camera[WIDTH] - 1 or v > camera[HEIGHT] - 1:
            continue
        if level != last_level or left > 1.12 * last_left or left < last_left / 1.12:
            w[0], w[1], w[2], w[3] = inverted_warp(A, determinant, level)
            last_left, last_level = left, level
            usable = warp_template(patch, centred, w, warped)
            if usable:
                contrast = quantize(warped, core)
        if not usable:
            continue
        score, k = best_corner(
            target, level, (u + 0.5) / scale - 0.5, (v + 0.5) / scale - 0.5, REACH_PX, core, contrast
        )
        if k < 0:
            continue
        apart = winner < 0 or winner_level != level or _apart(target.corners, k, winner)
        if score < best:
            second = best if apart else second
            best, winner, winner_level, energy = score, k, level, contrast
            template[:] = warped
        elif apart and score < second:
            second = score
    alone = best <= MAX_SHARE * energy + NOISE_FLOOR and second >= DISTINCTION * best
    return winner if alone else -1, winner_level


@kernel
def _apart(corners: Int32Array, a: int, b: int) -> bool:
    return bool(max(abs(corners[a, 0] - corners[b, 0]), abs(corners[a, 1] - corners[b, 1])) >= DISTINCT_PX)


@kernel
def search_rays(
    camera: FloatArray, R: FloatArray, t: FloatArray, rays: FloatArray, basis: FloatArray, patches: NDArray[np.uint8],
    inverse_depth: FloatArray, target: Target,
) -> tuple[BoolArray, FloatArray, IntArray]:  # fmt: skip
    """Find source patches in a target image somewhere along their rays.

    R, t: T_target_source. rays (C, 2): on the plane z = 1 of the source; basis (C, 4) as in ``predict``; patches (C,
    24, 24); inverse_depth (C, 2): (far, near) bounds [1/m]. The search moves in steps of 2.5 level px; the patch is
    warped again whenever its scale has changed by 12 %. A match must be 1.25 times better than any other corner at
    least 4 level px away.
    Returns found (C,) bool, position (C, 2) level-0 px, level (C,)."""
    n = rays.shape[0]
    found, position, level = np.zeros(n, np.bool_), np.zeros((n, 2)), np.zeros(n, np.int64)
    template, warped = np.empty((TEMPLATE, TEMPLATE), np.int32), np.empty((TEMPLATE, TEMPLATE), np.int32)
    memory = Memory(
        warped=warped, core=np.empty(64, np.int32), centred=np.zeros(2), A=np.empty(4), B=np.empty(4), w=np.empty(4)
    )
    for c in range(n):
        far, near = inverse_depth[c]
        k, lv = _search_ray(camera, R, t, rays[c], basis[c], patches[c], far, near, target, template, memory)
        if k < 0:
            continue
        x, y = float(target.corners[k, 0]), float(target.corners[k, 1])
        contrast = quantize(template, memory.core)
        found[c], position[c, 0], position[c, 1] = aligned(target, lv, template, memory.core, contrast, x, y)
        if found[c]:
            level[c] = lv
    return found, position, level
