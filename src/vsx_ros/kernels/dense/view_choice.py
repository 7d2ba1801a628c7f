"""Chooses the keyframes in which a cell of a plane is judged."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.jlinkage import first_largest

VIEWS = 6

Limits: TypeAlias = tuple[float, float, float, float, float, float, float]  # See ``choose_views``


class Views(NamedTuple):
    """Keyframes in which cells are compared. ids (N,); R (N, 3, 3) and t (N, 3): T_cam_world; centres (N, 3) world [m];
    slots (N,): their rows of the store of images, -1 for one that is not in it.

    store (S, B) uint8: undistorted, in levels, each half as large as the one before; table (levels, 3): offset, height,
    width; K (4,): fx, fy, cx, cy [px] of its level 0."""

    ids: IntArray
    R: FloatArray
    t: FloatArray
    centres: Points3
    slots: IntArray
    store: NDArray[np.uint8]
    table: IntArray
    K: FloatArray

    def at(self, rows: IntArray) -> Views:
        """The views in these rows."""
        return Views._make([*(column[rows] for column in self[:5]), *self[5:]])


@kernel
def _worth(views: Views, k: int, frame: FloatArray, x: float, y: float, z: float, half: float, limits: Limits) -> float:
    """How near and frontal keyframe k sees a cell, 0 when it does not see it: see ``choose_views``."""
    R, centres, K, table = views.R, views.centres, views.K, views.table
    nearest, farthest, grazing, _, _, _, _ = limits
    dx, dy, dz = centres[k, 0] - x, centres[k, 1] - y, centres[k, 2] - z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if not nearest <= distance <= farthest:
        return 0.0
    cosine = (dx * frame[2, 0] + dy * frame[2, 1] + dz * frame[2, 2]) / distance
    depth = -(R[k, 2, 0] * dx + R[k, 2, 1] * dy + R[k, 2, 2] * dz)
    if cosine < grazing or depth < 0.5 * distance:
        return 0.0
    margin = 1.5 * half * K[0] / depth
    u = K[2] - K[0] * (R[k, 0, 0] * dx + R[k, 0, 1] * dy + R[k, 0, 2] * dz) / depth
    v = K[3] - K[1] * (R[k, 1, 0] * dx + R[k, 1, 1] * dy + R[k, 1, 2] * dz) / depth
    if not (margin <= u < table[0, 2] - margin and margin <= v < table[0, 1] - margin):
        return 0.0
    return float(cosine / distance)


@kernel
def choose_views(
    views: Views, frame: FloatArray, x: float, y: float, z: float, half: float, limits: Limits, worth: FloatArray,
    chosen: IntArray,
) -> int:  # fmt: skip
    """Choose keyframes to compare a cell in: chosen[0] is the reference, the nearest and most frontal; the others, up
    to VIEWS, are the next best with parallax to it and each other. Returns their number, 0 without any.

    worth (N,): filled here. limits: nearest, farthest [m], least cosine of incidence, cosines of the least and largest
    parallax and of the least between two views, and 1 - cosine of a parallax that is large enough."""
    centres = views.centres
    _, _, _, least, largest, apart, enough = limits
    n = centres.shape[0]
    for k in range(n):
        worth[k] = _worth(views, k, frame, x, y, z, half, limits)
    first = first_largest(worth)
    if first < 0:
        return 0
    chosen[0] = first
    for k in range(n):
        if worth[k] > 0.0:
            cosine = _cosine_between(centres, k, first, x, y, z)
            worth[k] *= min(1.0, (1.0 - cosine) / enough) if largest <= cosine <= least else 0.0
    count = 1
    while count <= VIEWS:
        following = first_largest(worth)
        if following < 0:
            break
        chosen[count] = following
        count += 1
        for k in range(n):
            if worth[k] > 0.0 and _cosine_between(centres, k, following, x, y, z) > apart:
                worth[k] = 0.0
    return count


@kernel
def _cosine_between(centres: FloatArray, k: int, m: int, x: float, y: float, z: float) -> float:
    ax, ay, az = centres[k, 0] - x, centres[k, 1] - y, centres[k, 2] - z
    bx, by, bz = centres[m, 0] - x, centres[m, 1] - y, centres[m, 2] - z
    norm = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return float((ax * bx + ay * by + az * bz) / norm)
