"""Path length to every position and heading of a map by arcs of one length, and from there to any pose."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField, interpolate
from vsx_ros.kernels.planning.motions import BENDS, MOTIONS, SIGNS, Lattice, arc_places, places_are_free

UNREACHED = 16384  # arcs, more than any path has; half the range of int16
_RING = 4096  # states at first, a power of two; it doubles
_AROUND = 8  # cells, half of them to each side: about the length of an arc


@kernel
def flood(
    field: DistanceField, start: FloatArray, phi: float, lattice: Lattice, max_reverse: float
) -> tuple[NDArray[np.int16], float]:
    """Breadth-first search from a pose (3,) by arcs of one length, turning left, right or not by some heading bins.

    field: margin, which must not be negative along the path. A state is a heading bin and a cell of the lattice; the
    exact position of its first arrival is kept, so that errors do not accumulate. Returns level (headings, R, C) int16,
    arcs to each state or UNREACHED, and the arcs' length [m]."""
    values, resolution, x0, y0 = field
    headings, bins, cell, _ = lattice
    rows = int(math.ceil(values.shape[0] * resolution / cell))
    columns = int(math.ceil(values.shape[1] * resolution / cell))
    size = rows * columns
    step = bins * 2.0 * math.pi / headings / phi
    level = np.full((headings, rows, columns), UNREACHED, np.int16)
    i, j = int(math.floor((start[1] - y0) / cell)), int(math.floor((start[0] - x0) / cell))
    if not (0 <= i < rows and 0 <= j < columns):
        return level, step
    arcs = arc_places(headings, start[2], step, phi, resolution)
    last = arcs.shape[2] - 1
    reverses = int((max_reverse + 1e-9) / step)
    # A ring of the states whose arcs are still to be tried, and of their exact positions.
    states, at = np.empty(_RING, np.int32), np.empty((_RING, 2))
    backed = np.empty(_RING, np.int16)  # arcs in reverse since the last forward one
    level[0, i, j] = 0
    states[0], at[0, 0], at[0, 1], backed[0] = i * columns + j, start[0], start[1], 0
    head, tail = 0, 1
    while head < tail:
        if tail - head + MOTIONS > len(states):
            order = np.arange(head, head + len(states)) & (len(states) - 1)
            states, backed = np.append(states[order], states), np.append(backed[order], backed)
            at = np.concatenate((at[order], at))
            head, tail = 0, tail - head
        e = head & (len(states) - 1)
        h, place = states[e] // size, states[e] % size
        x, y, reverse = at[e, 0], at[e, 1], backed[e]
        arrived = level[h, place // columns, place % columns] + 1
        if arrived == UNREACHED:
            break
        margin = math.nan
        for m in range(MOTIONS):
            backwards = reverse + 1 if SIGNS[m] < 0 else 0
            if backwards > reverses:
                break
            nx, ny = x + arcs[h, m, last, 0], y + arcs[h, m, last, 1]
            a, b = int((ny - y0) / cell), int((nx - x0) / cell)
            g = (h + BENDS[m] * SIGNS[m] * bins + headings) % headings
            if ny < y0 or nx < x0 or a >= rows or b >= columns or level[g, a, b] != UNREACHED:
                continue
            if math.isnan(margin):
                margin = interpolate(field, x, y)
            # Open ground: the field (of slope about one) proves the whole arc free.
            if margin < 1.3 * step and not places_are_free(field, x, y, arcs[h, m], step):
                continue
            level[g, a, b] = arrived
            to = tail & (len(states) - 1)
            states[to] = (g * rows + a) * columns + b
            at[to, 0], at[to, 1], backed[to] = nx, ny, backwards
            tail += 1
        head += 1
    return level, step


@kernel
def flood_costs(
    level: NDArray[np.int16], step: float, start_theta: float, field: DistanceField, cell: float, phi: float,
    joined: BoolArray, poses: FloatArray,
) -> FloatArray:  # fmt: skip
    """(N,) path length [m] to poses (N, 3): the least over the states around each, plus the rest from there.

    level (headings, R, C) and step of ``flood`` in the margin field, with cells of size ``cell`` [m]. The rest is
    estimated from the offset: along, sideways and turn. A pose with negative margin or outside joined (H, W) bool is
    not reached: inf. Successive equal positions are faster."""
    _, resolution, x0, y0 = field
    headings, rows, columns = level.shape
    half = _AROUND // 2
    reached = np.full((headings, rows + 2 * half, columns + 2 * half), np.float32(np.inf))
    for g in range(headings):
        for a in range(rows):
            for b in range(columns):
                if level[g, a, b] != UNREACHED:
                    reached[g, a + half, b + half] = np.float32(level[g, a, b] * step)
    width = 2.0 * math.pi / headings
    bend = np.float32(0.5 * width / phi)
    size = np.float32(cell)
    out = np.full(poses.shape[0], np.inf)
    best = np.empty(_AROUND, np.float32)
    x, y, there = math.nan, math.nan, False
    i, j, dx0, dy0 = 0, 0, np.float32(0.0), np.float32(0.0)
    for k in range(poses.shape[0]):
        if poses[k, 0] != x or poses[k, 1] != y:
            x, y = poses[k, 0], poses[k, 1]
            there = interpolate(field, x, y) >= 0.0
            u, v = int(math.floor((y - y0) / resolution)), int(math.floor((x - x0) / resolution))
            there = there and 0 <= u < joined.shape[0] and 0 <= v < joined.shape[1] and joined[u, v]
            # The corner of the cells around, in the padded planes, and the offset of the pose from its middle.
            i, j = int(math.floor((y - y0) / cell + 0.5)), int(math.floor((x - x0) / cell + 0.5))
            dy0, dx0 = np.float32(y - y0 - (i - half + 0.5) * cell), np.float32(x - x0 - (j - half + 0.5) * cell)
        if not there:
            continue
        turn = (poses[k, 2] - start_theta) / width
        g = int(math.floor(turn + 0.5))
        here = reached[g % headings]
        left, right = reached[(g + 1) % headings], reached[(g - 1) % headings]
        off = np.float32(turn - g)
        stay, to_left, to_right = bend * abs(off), bend * abs(off - np.float32(1)), bend * abs(off + np.float32(1))
        c, s = np.float32(math.cos(poses[k, 2])), np.float32(math.sin(poses[k, 2]))
        best[:] = np.float32(np.inf)
        for di in range(_AROUND):
            dy = dy0 - np.float32(di) * size
            a = i + di
            for dj in range(_AROUND):
                dx = dx0 - np.float32(dj) * size
                d = here[a, j + dj] + stay
                e, f = left[a, j + dj] + to_left, right[a, j + dj] + to_right
                d = e if e < d else d
                d = f if f < d else d
                d += abs(c * dx + s * dy) + np.float32(2.0) * abs(c * dy - s * dx)
                best[dj] = d if d < best[dj] else best[dj]
        out[k] = best.min()
    return out
