"""Tables for searches over positions and headings: places along arcs of one length, and lengths of shortest Reeds-Shepp
words."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField, interpolate
from vsx_ros.kernels.planning.reeds_shepp import advance, reeds_shepp_shortest, room_for

BENDS = np.array([0, 1, -1, 0, 1, -1])
SIGNS = np.array([1, 1, 1, -1, -1, -1])
MOTIONS = 6  # Straight on, to the left and to the right; forwards, then in reverse

TABLE_PLACES, TABLE_STEP, TABLE_HEADINGS = 33, 0.2, 32  # a quadrant of 6.4 radii; farther away turns add little
_SPACING = 0.3  # between tested places of an arc, in cells of the margin field


class Lattice(NamedTuple):
    """Heading bins, bins turned by one arc, cell size [m]: every arc must leave its cell and its bin. most_states:
    limit of a search."""

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

    Places that the field proves free are skipped; the last one is tested first."""
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
    """Whether an arc of signed length at curvature kappa (of signed arc length) stays where the field is not negative.

    Steps as far as the field proves free: 0.7 of its value, as its slope is below 1.4 (``planning/corridor.py``); but
    at least a third of a cell."""
    total, sign, s = abs(length), 1.0 if length > 0.0 else -1.0, 0.0
    while True:
        px, py, _ = advance(x, y, theta, kappa, sign * s, 1.0)
        d = interpolate(field, px, py)
        if d < 0.0:
            return False
        if s >= total:
            return True
        s = min(total, s + max(0.3 * field.resolution, 0.7 * d))


@kernel
def reeds_shepp_table() -> Float32Array:
    """(TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1) float32: shortest lengths in radii from the origin.

    x and y in steps of TABLE_STEP radii from 0 on, headings around the circle (the last equals the first). One
    quadrant; the others are its mirror images."""
    out = np.empty((TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1), np.float32)
    word = room_for(1)
    for i in range(TABLE_PLACES):
        for j in range(TABLE_PLACES):
            for k in range(TABLE_HEADINGS + 1):
                theta = k * 2.0 * math.pi / TABLE_HEADINGS
                out[i, j, k] = reeds_shepp_shortest(i * TABLE_STEP, j * TABLE_STEP, theta, word)
    return out


@kernel
def look_up_length(table: Float32Array, x: float, y: float, theta: float) -> float:
    """Approximate shortest length in radii to (x, y, theta), x and y in radii; 0 outside the table.

    Interpolated in ``reeds_shepp_table``: an estimate for searches, neither a lower nor an upper bound."""
    if x < 0.0:
        x, theta = -x, -theta
    if y < 0.0:
        y, theta = -y, -theta
    u, v = x / TABLE_STEP, y / TABLE_STEP
    i, j = int(u), int(v)
    if i >= TABLE_PLACES - 1 or j >= TABLE_PLACES - 1:
        return 0.0
    w = theta / (2.0 * math.pi)
    w = (w - math.floor(w)) * TABLE_HEADINGS
    k = min(int(w), TABLE_HEADINGS - 1)
    u, v, w = u - i, v - j, w - k
    near = (1.0 - v) * table[i, j, k] + v * table[i, j + 1, k]
    far = (1.0 - v) * table[i + 1, j, k] + v * table[i + 1, j + 1, k]
    low = (1.0 - u) * near + u * far
    near = (1.0 - v) * table[i, j, k + 1] + v * table[i, j + 1, k + 1]
    far = (1.0 - v) * table[i + 1, j, k + 1] + v * table[i + 1, j + 1, k + 1]
    high = (1.0 - u) * near + u * far
    return float((1.0 - w) * low + w * high)
