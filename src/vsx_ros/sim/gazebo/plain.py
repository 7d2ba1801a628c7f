"""Solids of a link where nothing of it is drawn: they are drawn plain, so that no obstacle is invisible."""

from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.sim.gazebo.geometry import inverse, placed

MOST_PAIRS = 50_000_000  # of a solid and a triangle drawn, in a world: of more, some triangles are passed over
INSET_M = 0.005  # by which a plain solid is smaller than its shape: what is drawn on its faces stays visible
_MEETS_M = 0.02  # around a solid's faces: what is drawn there belongs to it,
_SPANS_M = 0.05  # if it reaches this far along each side, or half of the side; what only touches does not


def is_shown(solid: FloatArray, T_world: FloatArray, drawn: Sequence[FloatArray], step: int) -> bool:
    """Whether one of some drawn things (T, 3, 3) has triangles inside the box around a solid (N, 3, 3), or spans it.
    T_world: (4, 4) whose axes the box has. step: each so many triangles are looked at."""
    T_box = inverse(T_world)
    low, high = _box(placed(solid, T_box))
    margin, spans = np.minimum(_MEETS_M, 0.25 * (high - low)), np.minimum(_SPANS_M, 0.5 * (high - low))
    for corners in drawn:
        triangles = placed(corners[::step], T_box)
        begin, end = triangles.min(axis=1), triangles.max(axis=1)
        if ((begin < high - margin) & (end > low + margin)).all(axis=1).any():
            return True
        begin, end = np.maximum(begin, low - _MEETS_M), np.minimum(end, high + _MEETS_M)
        meets = (begin <= end).all(axis=1)
        if meets.any() and (end[meets].max(axis=0) - begin[meets].min(axis=0) >= spans).all():
            return True
    return False


def inset(solid: FloatArray, T_world: FloatArray) -> FloatArray:
    """The triangles (N, 3, 3), a little smaller along the axes of T_world."""
    local = placed(solid, inverse(T_world))
    low, high = _box(local)
    middle, sides = 0.5 * (low + high), high - low
    factor = 1.0 - 2.0 * np.minimum(INSET_M / np.maximum(sides, 1e-9), 0.25)
    return placed(middle + factor * (local - middle), T_world)


def _box(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    points = corners.reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)
