"""Search over cells and headings by arcs of bounded curvature to a goal."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.occupancy.clearance import DistanceField, interpolate
from vsx_ros.kernels.planning.motions import (
    BENDS,
    MOTIONS,
    SIGNS,
    Lattice,
    arc_is_free,
    arc_places,
    look_up_length,
    places_are_free,
)
from vsx_ros.kernels.planning.reeds_shepp import SEGMENTS, advance, reeds_shepp_shortest, room_for, shortest_word

_BUCKETS = 4  # for each arc length: paths in one bucket count as equal
_GREED = 1.2  # weight of the remaining length: far fewer states; paths are shortened afterwards
_SLACK = 1.0  # steps by which the estimate may exceed the remaining length
_MOST_ARCS = 32_000  # of a path; int16 counts them
_NEARER = 1.1  # factor by which the table may underestimate a word's length
_PLACES, _SPREAD = 1 << 12, 2_654_435_761  # at first in the table of states; odd, scatters neighbouring states in it
_ARCS_BITS, _ARCS = 16, (1 << 16) - 1  # of an entry in that table


@kernel
def word_is_free(
    field: DistanceField, x: float, y: float, theta: float, turns: IntArray, lengths: FloatArray, phi: float
) -> bool:
    """Whether a Reeds-Shepp word (lengths in radii) from a pose stays where the field is not negative."""
    for k in range(SEGMENTS):
        length = lengths[k] / phi
        if length != 0.0:
            if not arc_is_free(field, x, y, theta, turns[k] * phi, length):
                return False
            x, y, theta = advance(x, y, theta, turns[k], length, phi)
    return True


@kernel
def reverse_run(lengths: FloatArray) -> float:
    """The longest reverse leg of a word, in the units of its lengths (S,)."""
    longest, run = 0.0, 0.0
    for k in range(lengths.shape[0]):
        if lengths[k] < 0.0:
            run -= lengths[k]
            longest = max(longest, run)
        elif lengths[k] > 0.0:
            run = 0.0
    return longest


@part
def _place_of(table: IntArray, state: int) -> int:
    """Where a table (T,) holds an entry for a state, or would; T is a power of two, and half the places are empty (-1).

    Memory thus grows with the states that were reached, not with the map. An entry is a state, then in 16 bits the arcs
    of its cheapest arrival plus one, or 0 once it is done. All bits of an empty place are set: more than any arcs."""
    mask: int = table.shape[0] - 1
    place: int = (state * _SPREAD >> _ARCS_BITS) & mask
    while table[place] >= 0 and table[place] >> _ARCS_BITS != state:
        place = (place + 1) & mask
    return place


@kernel
def _twice_as_long(table: IntArray) -> IntArray:
    """The same entries in twice as many places."""
    longer = np.full(2 * table.shape[0], -1, np.int64)
    for entry in table:
        if entry >= 0:
            longer[_place_of(longer, entry >> _ARCS_BITS)] = entry
    return longer


@kernel
def lattice_search(
    field: DistanceField, start: FloatArray, phi: float, lattice: Lattice, max_reverse: float, goal: FloatArray,
    remaining: FloatArray, table: Float32Array,
) -> tuple[FloatArray, IntArray, NDArray[np.int8], float, int]:  # fmt: skip
    """Search from a pose (3,) by arcs of one length, turning left, right or not by some heading bins, both ways.

    field: margin, which must not be negative on the path. A state is a cell of the lattice and a heading bin; the exact
    pose of its cheapest arrival is kept, so that no error adds up. A* search to the goal (3,), greedy by a fifth.
    remaining (H, W) [m]: lower bound of the rest around obstacles; table (``reeds_shepp_table``): the rest without
    obstacles. The shortest Reeds-Shepp word to the goal is tried on the way. It ends when no state can improve on the
    best. At most ``most_states`` arrivals are recorded.

    Returns poses (N, 3), parents (N,), motions (N,) of the arrivals, step [m] and the arrival that reaches the goal, or
    -1."""
    values, resolution, x0, y0 = field
    headings, bins, cell, most = lattice
    rows = int(math.ceil(values.shape[0] * resolution / cell))
    columns = int(math.ceil(values.shape[1] * resolution / cell))
    step = bins * 2.0 * math.pi / headings / phi
    capacity = min(rows * columns * headings, most)
    known = np.full(_PLACES, -1, np.int64)
    states = np.empty(capacity, np.int64)
    poses = np.empty((capacity, 3))
    parents = np.empty(capacity, np.int64)
    motions = np.empty(capacity, np.int8)
    reversed_m = np.empty(capacity)
    left_m = np.empty(capacity)
    hopeful = np.empty(capacity, np.bool_)  # words much shorter than the path around obstacles are not free
    following = np.empty(capacity, np.int64)
    way = room_for(1)
    arcs = arc_places(headings, start[2], step, phi, resolution)
    last = arcs.shape[2] - 1
    width = 2.0 * math.pi / headings
    cosines = np.cos(start[2] + np.arange(headings) * width)
    sines = np.sin(start[2] + np.arange(headings) * width)
    best, winner = np.inf, -1
    i, j = int(math.floor((start[1] - y0) / cell)), int(math.floor((start[0] - x0) / cell))
    if not (0 <= i < rows and 0 <= j < columns):
        return poses[:0], parents[:0], motions[:0], step, winner
    # Arrivals wait in buckets of total length; each bucket is a linked list, last in first out.
    buckets = np.full(8 * _BUCKETS * (rows + columns) + 1, -1, np.int64)
    states[0] = (i * columns + j) * headings
    known[_place_of(known, states[0])] = states[0] << _ARCS_BITS | 1
    poses[0] = start
    parents[0], motions[0], reversed_m[0], left_m[0], hopeful[0], following[0] = -1, -1, 0.0, 0.0, True, -1
    buckets[0] = 0
    count, bucket = 1, 0
    while bucket < buckets.shape[0]:
        node = buckets[bucket]
        if node < 0:
            bucket += 1
            if bucket * step / _BUCKETS >= best:
                break
            continue
        buckets[bucket] = following[node]
        state = states[node]
        place = _place_of(known, state)
        arrived = known[place] & _ARCS  # by one more arc
        if arrived == 0:
            continue
        known[place] -= arrived
        if 2 * (count + MOTIONS) > known.shape[0]:
            known = _twice_as_long(known)
        h = state % headings
        x, y = poses[node, 0], poses[node, 1]
        reached = (arrived - 1) * step
        if reached + left_m[node] - _SLACK * step >= best:
            continue
        dx, dy = goal[0] - x, goal[1] - y
        if hopeful[node] and (dx * dx + dy * dy < 0.25 / (phi * phi) or state % 4 == 0):
            theta, c, s = poses[node, 2], cosines[h], sines[h]
            px, py = phi * (c * dx + s * dy), phi * (c * dy - s * dx)
            below = (best - reached) * phi
            word = reeds_shepp_shortest(px, py, goal[2] - theta, way, below) / phi
            if (
                reached + word < best
                and reversed_m[node] + reverse_run(way.lengths[0]) / phi <= max_reverse + 1e-9
                and word_is_free(field, x, y, theta, way.turns[0], way.lengths[0], phi)
            ):
                best, winner = reached + word, node
        margin = interpolate(field, x, y)
        for m in range(MOTIONS):
            backwards = reversed_m[node] + step if SIGNS[m] < 0 else 0.0
            if backwards > max_reverse or count >= capacity or arrived > _MOST_ARCS:
                continue
            nx, ny = x + arcs[h, m, last, 0], y + arcs[h, m, last, 1]
            a, b = int((ny - y0) / cell), int((nx - x0) / cell)
            if ny < y0 or nx < x0 or a >= rows or b >= columns:
                continue
            g = (h + BENDS[m] * SIGNS[m] * bins + headings) % headings
            state = (a * columns + b) * headings + g
            place = _place_of(known, state)
            if known[place] & _ARCS <= arrived + 1:
                continue
            # Open ground: the field (of slope about one) proves the whole arc free.
            if margin < 1.3 * step and not places_are_free(field, x, y, arcs[h, m], step):
                continue
            v = min(int((ny - y0) / resolution), remaining.shape[0] - 1)
            u = min(int((nx - x0) / resolution), remaining.shape[1] - 1)
            around = remaining[v, u]
            dx, dy = goal[0] - nx, goal[1] - ny
            c, s = cosines[g], sines[g]
            turned = start[2] + g * width
            direct = look_up_length(table, phi * (c * dx + s * dy), phi * (c * dy - s * dx), goal[2] - turned) / phi
            left = max(math.sqrt(dx * dx + dy * dy), around, direct)
            queue = max(bucket, int(_BUCKETS * (arrived + _GREED * left / step)))
            if queue >= buckets.shape[0]:
                continue
            known[place], states[count] = state << _ARCS_BITS | arrived + 1, state
            poses[count, 0], poses[count, 1], poses[count, 2] = nx, ny, turned
            parents[count], motions[count], reversed_m[count], left_m[count] = node, m, backwards, left
            hopeful[count] = direct == 0.0 or around <= _NEARER * direct + step
            following[count] = buckets[queue]
            buckets[queue] = count
            count += 1
    return poses[:count], parents[:count], motions[:count], step, winner


@kernel
def lattice_way(
    poses: FloatArray, parents: IntArray, motions: NDArray[np.int8], winner: int, step: float, goal: FloatArray,
    phi: float,
) -> tuple[IntArray, FloatArray]:  # fmt: skip
    """Turns (S,) and signed lengths (S,) [m] from the start of a search to its winner and on to the goal (3,)."""
    hops = 0
    node = winner
    while parents[node] >= 0:
        hops += 1
        node = parents[node]
    turns = np.zeros(hops + SEGMENTS, np.int64)
    lengths = np.zeros(hops + SEGMENTS)
    node = winner
    for k in range(hops - 1, -1, -1):
        turns[k], lengths[k] = BENDS[motions[node]], SIGNS[motions[node]] * step
        node = parents[node]
    word = room_for(1)
    shortest_word(poses[winner], goal, phi, word)
    turns[hops:], lengths[hops:] = word.turns[0], word.lengths[0] / phi
    return turns, lengths
