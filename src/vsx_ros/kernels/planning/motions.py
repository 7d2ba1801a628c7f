"""The arcs of one length that searches over positions and headings drive by, looked at without trigonometry."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField, interpolate
from vsx_ros.kernels.planning.reeds_shepp import advance

BENDS = np.array([0, 1, -1, 0, 1, -1])
SIGNS = np.array([1, 1, 1, -1, -1, -1])
MOTIONS = 6
"""Straight on, to the left and to the right; forwards, then in reverse."""

_SPACING = 0.3  # of a cell of the margin field, at which an arc is looked at


class Lattice(NamedTuple):
    """Heading bins, bins turned by one arc, cell size [m]: every arc must leave its cell and its bin.
    most_states: where a search gives up."""

    headings: int
    bins: int
    cell_m: float
    most_states: int


@kernel
def arc_places(headings: int, theta: float, step: float, phi: float, resolution: float) -> FloatArray:
    """(headings, MOTIONS, P, 2) places along the arcs from the origin at every heading, from theta on."""
    places = int(math.ceil(step / (_SPACING * resolution)))
    out = np.empty((headings, MOTIONS, places + 1, 2))
    for g in range(headings):
        head = theta + g * 2.0 * math.pi / headings
        for m in range(MOTIONS):
            for p in range(places + 1):
                length = SIGNS[m] * step * p / places
                out[g, m, p, 0], out[g, m, p, 1], _ = advance(0.0, 0.0, head, float(BENDS[m]), length, phi)
    return out


@kernel
def places_are_free(field: DistanceField, x: float, y: float, places: FloatArray, step: float) -> bool:
    """Whether an arc of length ``step`` from (x, y) by ``places`` (P, 2) stays where the field is not negative.

    Places that the field proves free are passed over; the last one is looked at first.
    """
    last = places.shape[0] - 1
    if interpolate(field, x + places[last, 0], y + places[last, 1]) < 0.0:
        return False
    p = 0
    while p < last:
        d = interpolate(field, x + places[p, 0], y + places[p, 1])
        if d < 0.0:
            return False
        p += max(1, int(0.7 * d * last / step))
    return True


@kernel
def arc_is_free(field: DistanceField, x: float, y: float, theta: float, kappa: float, length: float) -> bool:
    """Whether an arc of signed length at curvature kappa (of the signed arc length) stays where the field is positive.

    Steps as far as the field (of slope at most ``1 + ramp``) proves free, but at least a third of a cell.
    """
    total, sign, s = abs(length), 1.0 if length > 0.0 else -1.0, 0.0
    while True:
        px, py, _ = advance(x, y, theta, kappa, sign * s, 1.0)
        d = interpolate(field, px, py)
        if d < 0.0:
            return False
        if s >= total:
            return True
        s = min(total, s + max(0.3 * field.resolution, 0.7 * d))
