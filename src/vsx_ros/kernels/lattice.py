"""Breadth-first searches over cells, and over cells and headings with arcs of bounded curvature."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel
from vsx_ros.kernels.clearance import arc_is_free, interpolate
from vsx_ros.kernels.reeds_shepp import MAX_WORDS, SEGMENTS, advance, look_up_length, reeds_shepp_shortest

MOTIONS = 6
_BUCKETS = 4
_GREED = 1.2  # what is left counts so much: far fewer states for ways that are shortened afterwards anyway
_SLACK = 1.0  # steps by which the guide may overestimate what is left
_AROUND = 3  # cells; an arc is about as long
_BENDS = np.array([0, 1, -1, 0, 1, -1])
_SIGNS = np.array([1, 1, 1, -1, -1, -1])


@kernel
def wavefront(open_cells: Any, row: int, column: int) -> Any:
    """(H, W) length [cells] of the shortest 8-connected way from a cell through open cells; inf where there is none.

    open_cells (H, W) bool. A diagonal step needs both cells beside it open, except from the start. Exact.
    """
    rows, columns = open_cells.shape
    size = rows * columns
    distance = np.full((rows, columns), np.inf)
    queued = np.zeros((rows, columns), np.bool_)
    ring = np.empty(size + 1, np.int64)
    head, tail = 0, 1
    ring[0] = row * columns + column
    distance[row, column] = 0.0
    queued[row, column] = True
    diagonal = math.sqrt(2.0)
    while head != tail:
        i, j = ring[head] // columns, ring[head] % columns
        head = head + 1 if head < size else 0
        queued[i, j] = False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= rows or b >= columns or not open_cells[a, b]:
                    continue
                corner = di != 0 and dj != 0
                if corner and not (open_cells[i, b] and open_cells[a, j]) and not (i == row and j == column):
                    continue
                d = distance[i, j] + (diagonal if corner else 1.0)
                if d < distance[a, b] - 1e-9:
                    distance[a, b] = d
                    if not queued[a, b]:
                        queued[a, b] = True
                        ring[tail] = a * columns + b
                        tail = tail + 1 if tail < size else 0
    return distance


@kernel
def word_is_free(
    values: Any,
    resolution: float,
    x0: float,
    y0: float,
    x: float,
    y: float,
    theta: float,
    turns: Any,
    lengths: Any,
    phi: float,
) -> bool:
    """Whether a Reeds-Shepp word (lengths in radii) from a pose stays where the field is not negative."""
    for k in range(SEGMENTS):
        length = lengths[k] / phi
        if length != 0.0:
            if not arc_is_free(values, resolution, x0, y0, x, y, theta, turns[k] * phi, length):
                return False
            x, y, theta = advance(x, y, theta, turns[k], length, phi)
    return True


@kernel
def reverse_run(lengths: Any) -> float:
    """The longest reverse leg of a word, in the units of its lengths (S,)."""
    longest, run = 0.0, 0.0
    for k in range(lengths.shape[0]):
        if lengths[k] < 0.0:
            run -= lengths[k]
            longest = max(longest, run)
        elif lengths[k] > 0.0:
            run = 0.0
    return longest


@kernel
def lattice_search(
    values: Any,
    resolution: float,
    x0: float,
    y0: float,
    start: Any,
    phi: float,
    headings: int,
    bins: int,
    cell: float,
    max_reverse: float,
    goal: Any,
    remaining: Any,
    table: Any,
    most: int,
) -> Any:
    """Search from a pose by arcs of one length, turning by ``bins`` of ``headings`` bins left, right or not, both ways.

    values (H, W): margin field [m] in which the way must not be negative. start (3,). Every state is a cell of size
    ``cell`` [m] and a heading bin; the pose of its cheapest arrival is kept exactly, so no error adds up. With a goal
    (3,) it is an A* search, greedy by a fifth: remaining (H, W) [m] is a lower bound of what is left around the
    obstacles and ``table`` (``reeds_shepp_table``) tells what is left without any; the shortest Reeds-Shepp word to the
    goal is tried on the way, and the search ends when no state promises to improve on the best. With a goal of NaN
    everything is reached, cheapest first. No more than ``most`` arrivals are recorded.

    Returns level (R, C, headings) int32 (in steps, -1 unreached), poses (N, 3), parents (N,), motions (N,) of the
    arrivals, step [m], the arrival from which the goal is reached and that way's length [m], or (-1, inf).
    """
    rows = int(math.ceil(values.shape[0] * resolution / cell))
    columns = int(math.ceil(values.shape[1] * resolution / cell))
    step = bins * 2.0 * math.pi / headings / phi
    size = rows * columns * headings
    capacity = min(size, most)
    level = np.full((rows, columns, headings), -1, np.int32)
    states = np.empty(capacity, np.int64)
    poses = np.empty((capacity, 3))
    parents = np.empty(capacity, np.int64)
    motions = np.empty(capacity, np.int8)
    reversed_m = np.empty(capacity)
    left_m = np.empty(capacity)
    following = np.empty(capacity, np.int64)
    turns = np.zeros((MAX_WORDS, SEGMENTS), np.int64)
    lengths = np.zeros((MAX_WORDS, SEGMENTS))
    word_turns = np.zeros(SEGMENTS, np.int64)
    word_lengths = np.zeros(SEGMENTS)
    moves = np.empty((MOTIONS, 3))  # displacement of each motion in the base frame
    for m in range(MOTIONS):
        moves[m] = advance(0.0, 0.0, 0.0, float(_BENDS[m]), _SIGNS[m] * step, phi)
    seek = not math.isnan(goal[0])
    best, winner = np.inf, -1
    i, j = int(math.floor((start[1] - y0) / cell)), int(math.floor((start[0] - x0) / cell))
    if not (0 <= i < rows and 0 <= j < columns):
        return level, poses[:0], parents[:0], motions[:0], step, winner, best
    # Arrivals wait in buckets of total length; each bucket is a linked list, last in first out.
    buckets = np.full(8 * _BUCKETS * (rows + columns) + 1, -1, np.int64)
    level[i, j, 0] = 0
    states[0] = (i * columns + j) * headings
    poses[0] = start
    parents[0], motions[0], reversed_m[0], left_m[0], following[0] = -1, -1, 0.0, 0.0, -1
    done = np.zeros(size, np.bool_)
    buckets[0] = 0
    count, bucket = 1, 0
    while bucket < buckets.shape[0]:
        node = buckets[bucket]
        if node < 0:
            bucket += 1
            if seek and bucket * step / _BUCKETS >= best:
                break
            continue
        buckets[bucket] = following[node]
        state = states[node]
        if done[state]:
            continue
        done[state] = True
        h = state % headings
        i, j = state // headings // columns, state // headings % columns
        x, y, theta = poses[node, 0], poses[node, 1], poses[node, 2]
        reached = level[i, j, h] * step
        if seek:
            if reached + left_m[node] - _SLACK * step >= best:
                continue
            dx, dy = goal[0] - x, goal[1] - y
            if math.hypot(dx, dy) < 0.5 / phi or state % 4 == 0:
                c, s = math.cos(theta), math.sin(theta)
                px, py = phi * (c * dx + s * dy), phi * (c * dy - s * dx)
                word = reeds_shepp_shortest(px, py, goal[2] - theta, turns, lengths, word_turns, word_lengths) / phi
                if (
                    reached + word < best
                    and reversed_m[node] + reverse_run(word_lengths) / phi <= max_reverse + 1e-9
                    and word_is_free(values, resolution, x0, y0, x, y, theta, word_turns, word_lengths, phi)
                ):
                    best, winner = reached + word, node
        margin = interpolate(values, resolution, x0, y0, x, y)
        c, s = math.cos(theta), math.sin(theta)
        arrived = level[i, j, h] + 1
        for m in range(MOTIONS):
            backwards = reversed_m[node] + step if _SIGNS[m] < 0 else 0.0
            if backwards > max_reverse or count >= capacity:
                continue
            nx = x + c * moves[m, 0] - s * moves[m, 1]
            ny = y + s * moves[m, 0] + c * moves[m, 1]
            a, b = int((ny - y0) / cell), int((nx - x0) / cell)
            if ny < y0 or nx < x0 or a >= rows or b >= columns:
                continue
            g = (h + _BENDS[m] * _SIGNS[m] * bins + headings) % headings
            before = level[a, b, g]
            if before >= 0 and (before <= arrived or done[(a * columns + b) * headings + g]):
                continue
            # Open ground: the field (of slope about one) proves the whole arc free.
            if margin < 1.3 * step and not arc_is_free(
                values, resolution, x0, y0, x, y, theta, _BENDS[m] * phi, _SIGNS[m] * step
            ):
                continue
            left = 0.0
            if seek:
                v = min(int((ny - y0) / resolution), remaining.shape[0] - 1)
                u = min(int((nx - x0) / resolution), remaining.shape[1] - 1)
                left = remaining[v, u]
                dx, dy = goal[0] - nx, goal[1] - ny
                turned = theta + _BENDS[m] * _SIGNS[m] * step * phi
                tc, ts = math.cos(turned), math.sin(turned)
                px, py = phi * (tc * dx + ts * dy), phi * (tc * dy - ts * dx)
                left = max(math.hypot(dx, dy), left, look_up_length(table, px, py, goal[2] - turned) / phi)
            place = max(bucket, int(_BUCKETS * (arrived + _GREED * left / step)))
            if place >= buckets.shape[0]:
                continue
            level[a, b, g] = arrived
            states[count] = (a * columns + b) * headings + g
            poses[count, 0], poses[count, 1] = nx, ny
            poses[count, 2] = start[2] + g * 2.0 * math.pi / headings
            parents[count], motions[count], reversed_m[count], left_m[count] = node, m, backwards, left
            following[count] = buckets[place]
            buckets[place] = count
            count += 1
    return level, poses[:count], parents[:count], motions[:count], step, winner, best


@kernel
def lattice_costs(
    level: Any, step: float, start_theta: float, x0: float, y0: float, cell: float, phi: float, poses: Any
) -> Any:
    """(N,) travel length [m] to poses (N, 3): the least over the states around each, plus what remains from there.

    level (R, C, headings) of ``lattice_search``. What remains is estimated from the offset: along, aside and turn.
    """
    rows, columns, headings = level.shape
    width = 2.0 * math.pi / headings
    out = np.full(poses.shape[0], np.inf)
    nearest = np.full((rows, columns), np.inf)  # the least over all headings, to pass over most of what is around
    for a in range(rows):
        for b in range(columns):
            for g in range(headings):
                if level[a, b, g] >= 0:
                    nearest[a, b] = min(nearest[a, b], level[a, b, g] * step)
    for k in range(poses.shape[0]):
        x, y, theta = poses[k, 0], poses[k, 1], poses[k, 2]
        i, j = int(math.floor((y - y0) / cell)), int(math.floor((x - x0) / cell))
        turn = (theta - start_theta) / width
        g = int(math.floor(turn + 0.5))
        c, s = math.cos(theta), math.sin(theta)
        for di in range(-_AROUND, _AROUND + 1):
            for dj in range(-_AROUND, _AROUND + 1):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns or nearest[a, b] >= out[k]:
                    continue
                dx, dy = x - (x0 + (b + 0.5) * cell), y - (y0 + (a + 0.5) * cell)
                along, aside = abs(c * dx + s * dy), abs(c * dy - s * dx)
                if nearest[a, b] + along + 2.0 * aside >= out[k]:
                    continue
                for dg in range(-1, 2):
                    reached = level[a, b, (g + dg) % headings]
                    if reached >= 0:
                        rest = along + 2.0 * aside + 0.5 * abs(turn - g - dg) * width / phi
                        out[k] = min(out[k], reached * step + rest)
    return out


@kernel
def lattice_way(
    poses: Any, parents: Any, motions: Any, winner: int, step: float, goal: Any, phi: float
) -> tuple[Any, Any]:
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
        turns[k], lengths[k] = _BENDS[motions[node]], _SIGNS[motions[node]] * step
        node = parents[node]
    pose = poses[winner]
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    work_turns = np.zeros((MAX_WORDS, SEGMENTS), np.int64)
    work_lengths = np.zeros((MAX_WORDS, SEGMENTS))
    px, py = phi * (c * dx + s * dy), phi * (c * dy - s * dx)
    reeds_shepp_shortest(px, py, goal[2] - pose[2], work_turns, work_lengths, turns[hops:], lengths[hops:])
    lengths[hops:] /= phi
    return turns, lengths
