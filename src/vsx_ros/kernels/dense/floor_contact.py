"""Where a wall meets the floor: the brightness steps at the line where its plane cuts z = 0, and nowhere near it.

A gap in the wall has no such step, because the floor continues through it."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.surface_cells import LEVELS, sample
from vsx_ros.kernels.dense.view_choice import Views
from vsx_ros.kernels.geometry import transform

ROWS = 4
ACROSS = 3
WITNESSES, APART_M = 8, 0.3  # keyframes kept for each column, and least distance between two of them


@kernel
def _strip(
    views: Views, k: int, origin: FloatArray, along: FloatArray, across: FloatArray, begin: float, end: float
) -> tuple[float, float, bool]:
    """Mean and standard deviation [grey levels] of a rectangle: from ``begin`` to ``end`` [m] in the direction along
    (3,) from origin (3,), across (3,) [m] to both sides; and whether all of it is in the image."""
    pixels, R, t, K = views.store[views.slots[k]], views.R[k], views.t[k], views.K
    total = squares = 0.0
    for i in range(ROWS):
        a = begin + (end - begin) * (i + 0.5) / ROWS
        for j in range(ACROSS):
            b = (2.0 * j + 1.0) / ACROSS - 1.0
            x = origin[0] + a * along[0] + b * across[0]
            y = origin[1] + a * along[1] + b * across[1]
            z = origin[2] + a * along[2] + b * across[2]
            px, py, pz = transform(R, t, x, y, z)
            if pz < 0.1:
                return 0.0, 0.0, False
            level = 0
            spacing = K[0] * (end - begin) / ROWS / pz
            while level < LEVELS - 1 and spacing > 2.0:
                spacing *= 0.5
                level += 1
            shrink = 1.0 / (1 << level)
            u = (px / pz * K[0] + K[2] + 0.5) * shrink - 0.5
            v = (py / pz * K[1] + K[3] + 0.5) * shrink - 0.5
            offset, height, width = views.table[level, 0], views.table[level, 1], views.table[level, 2]
            value = sample(pixels, offset, height, width, u, v)
            if value < 0.0:
                return 0.0, 0.0, False
            total += value
            squares += value * value
    n = ROWS * ACROSS
    mean = total / n
    return mean, math.sqrt(max(0.0, squares / n - mean * mean)), True


@kernel
def contact_steps(
    views: Views, feet: FloatArray, front: FloatArray, right: FloatArray,
    strips: tuple[float, float, float, float, float], shifts: FloatArray,
    limits: tuple[float, float, float, float, int],
) -> tuple[IntArray, FloatArray, IntArray, IntArray]:  # fmt: skip
    """Brightness steps at the feet of columns of one plane, over the keyframes that see them from its front.

    feet (C, 3): where the columns meet the floor, world. front (3,): horizontal, away from the wall; right (3,): along
    it. strips: half width, begin and end on the wall, begin and least length on the floor [m] (longer where less than
    two pixels high). shifts (S,) [m]: the test is repeated this far in front of the wall. limits: nearest, farthest
    [m], least cosine of incidence, grey levels that make a step (added to the strips' own roughness), most keyframes
    (newest first).
    Returns seen (C,): number of keyframes; steps (C, S): mean signed step over them, 1 at the threshold; reference
    (C,): the nearest keyframe with a step of the mean's sign, -1 without; witnesses (C, WITNESSES): up to so many such
    keyframes that are apart, newest first, -1 for the rest."""
    nearest, farthest, grazing, least, most = limits
    half_width, low, high, begin, length = strips
    R, centres = views.R, views.centres
    n = feet.shape[0]
    seen, steps = np.zeros(n, np.int64), np.zeros((n, shifts.shape[0]))
    reference, witness = np.full(n, -1, np.int64), np.zeros(2, np.int64)
    witnesses, apart = np.full((n, WITNESSES), -1, np.int64), np.zeros((2, WITNESSES), np.int64)
    up = np.array([0.0, 0.0, 1.0])
    across = half_width * right
    origin = np.zeros(3)
    found, closest = np.zeros(shifts.shape[0]), np.zeros(2)
    for i in range(n):
        closest[:], witness[:], apart[:] = np.inf, -1, -1
        for k in range(centres.shape[0] - 1, -1, -1):
            dx, dy, dz = centres[k, 0] - feet[i, 0], centres[k, 1] - feet[i, 1], centres[k, 2] - feet[i, 2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            if not nearest <= distance <= farthest or dx * front[0] + dy * front[1] < grazing * distance:
                continue
            depth = -(R[k, 2, 0] * dx + R[k, 2, 1] * dy + R[k, 2, 2] * dz)
            if depth < 0.5 * distance:
                continue
            reach = begin + max(length, 2.0 * depth * depth / (views.K[1] * max(dz, 0.05)))
            good = True
            for s in range(shifts.shape[0]):
                for axis in range(3):
                    origin[axis] = feet[i, axis] + shifts[s] * front[axis]
                above, rough, good = _strip(views, k, origin, up, across, low, high)
                if not good:
                    break
                below, coarse, good = _strip(views, k, origin, front, across, begin, reach)
                if not good:
                    break
                found[s] = min(2.0, max(-2.0, (above - below) / (least + rough + coarse)))
            if not good:
                continue
            seen[i] += 1
            steps[i] += found
            brighter = 1 if found[0] > 0.0 else 0
            if abs(found[0]) >= 1.0:
                _keep_apart(apart[brighter], k, centres)
                if distance < closest[brighter]:
                    closest[brighter] = distance
                    witness[brighter] = k
            if seen[i] >= most:
                break
        if seen[i] > 0:
            steps[i] /= seen[i]
            brighter = 1 if steps[i, 0] > 0.0 else 0
            reference[i] = witness[brighter]
            witnesses[i] = apart[brighter]
    return seen, steps, reference, witnesses


@kernel
def _keep_apart(kept: IntArray, k: int, centres: FloatArray) -> None:
    """Add keyframe k to those kept, in place, unless one of them was near it or all places are taken."""
    for slot in range(kept.shape[0]):
        if kept[slot] < 0:
            kept[slot] = k
            return
        away = 0.0
        for axis in range(3):
            away += (centres[kept[slot], axis] - centres[k, axis]) ** 2
        if away < APART_M * APART_M:
            return
