"""RRT-Connect over Reeds-Shepp words.

J. J. Kuffner, S. M. LaValle, "RRT-Connect", ICRA 2000; every extension is a motion of bounded curvature (paper 4.4).
A way is a list of segments: turn (+1 left, -1 right, 0 straight) and signed length [m].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.planning.lattice import reverse_run, word_is_free
from vsx_ros.kernels.planning.reeds_shepp import LONGER, MAX_WORDS, SEGMENTS, advance, reeds_shepp_shortest

MAX_SEGMENTS = 512
_NEAREST = 3


@kernel
def random_unit(state: NDArray[np.uint64]) -> float:
    """Uniform in [0, 1) from a xorshift64* generator; state (1,) uint64, never zero."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@kernel
def shortest_word(
    a: FloatArray,
    b: FloatArray,
    phi: float,
    work_turns: IntArray,
    work_lengths: FloatArray,
    turns: IntArray,
    lengths: FloatArray,
    below: float = LONGER,
) -> float:
    """Length [m] of the shortest word from pose a (3,) to b (3,); infinite where none is shorter than ``below`` [m]."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = phi * (c * dx + s * dy), phi * (c * dy - s * dx)
    return reeds_shepp_shortest(x, y, b[2] - a[2], work_turns, work_lengths, turns, lengths, below * phi) / phi


@kernel
def _truncate(lengths: FloatArray, most: float) -> None:
    """Cut a word (lengths in radii, changed in place) to a total of ``most`` radii."""
    left = most
    for k in range(SEGMENTS):
        size = abs(lengths[k])
        if size > left:
            lengths[k] *= left / size
        left = max(0.0, left - abs(lengths[k]))


@kernel
def _flipped_reverse_run(lengths: FloatArray) -> float:
    return reverse_run(-lengths)


@kernel
def rrt_connect(
    values: FloatArray,
    resolution: float,
    x0: float,
    y0: float,
    open_cells: IntArray,
    start: FloatArray,
    goal: FloatArray,
    phi: float,
    reach: float,
    max_reverse: float,
    seed: np.uint64,
    iterations: int,
) -> tuple[IntArray, FloatArray, int]:
    """A way from start (3,) to goal (3,) through the margin field, or none.

    open_cells (M,): flat indices of the cells to sample from. reach [m]: longest extension. max_reverse [m]: longest
    reverse leg within one extension. Returns turns (S,), lengths (S,) [m] (empty when not found) and iterations used.
    """
    columns = values.shape[1]
    capacity = iterations + 2
    poses = np.empty((2, capacity, 3))
    parent = np.full((2, capacity), -1, np.int64)
    edge_turns = np.zeros((2, capacity, SEGMENTS), np.int64)
    edge_lengths = np.zeros((2, capacity, SEGMENTS))
    sizes = np.ones(2, np.int64)
    poses[0, 0], poses[1, 0] = start, goal
    state = np.array([seed], np.uint64)
    work_turns = np.zeros((MAX_WORDS, SEGMENTS), np.int64)
    work_lengths = np.zeros((MAX_WORDS, SEGMENTS))
    turns = np.zeros(SEGMENTS, np.int64)
    lengths = np.zeros(SEGMENTS)
    sample = np.empty(3)
    near = np.empty(_NEAREST, np.int64)
    near_d = np.empty(_NEAREST)
    joined_a, joined_b = -1, -1
    bridge_turns = np.zeros(SEGMENTS, np.int64)
    bridge_lengths = np.zeros(SEGMENTS)
    used = 0
    for iteration in range(iterations):
        used = iteration + 1
        tree = iteration % 2
        if iteration > 0:
            cell = open_cells[int(random_unit(state) * open_cells.shape[0])]
            sample[0] = x0 + (cell % columns + random_unit(state)) * resolution
            sample[1] = y0 + (cell // columns + random_unit(state)) * resolution
            sample[2] = (2.0 * random_unit(state) - 1.0) * math.pi
            best, winner = np.inf, 0
            for k in range(sizes[tree]):
                d = math.hypot(poses[tree, k, 0] - sample[0], poses[tree, k, 1] - sample[1])
                if d < best:
                    turn = abs(poses[tree, k, 2] - sample[2]) % (2.0 * math.pi)
                    d += 0.4 / phi * min(turn, 2.0 * math.pi - turn)
                    if d < best:
                        best, winner = d, k
            shortest_word(poses[tree, winner], sample, phi, work_turns, work_lengths, turns, lengths)
            _truncate(lengths, reach * phi)
            run = reverse_run(lengths) if tree == 0 else _flipped_reverse_run(lengths)
            x, y, theta = poses[tree, winner, 0], poses[tree, winner, 1], poses[tree, winner, 2]
            if run > max_reverse * phi + 1e-9 or not word_is_free(
                values, resolution, x0, y0, x, y, theta, turns, lengths, phi
            ):
                continue
            for k in range(SEGMENTS):
                x, y, theta = advance(x, y, theta, turns[k], lengths[k] / phi, phi)
            new = sizes[tree]
            poses[tree, new, 0], poses[tree, new, 1], poses[tree, new, 2] = x, y, theta
            parent[tree, new] = winner
            edge_turns[tree, new] = turns
            edge_lengths[tree, new] = lengths
            sizes[tree] += 1
        else:
            new = 0
        # Try to join the new state to the nearest few of the other tree.
        other = 1 - tree
        found = 0
        for k in range(sizes[other]):
            turn = abs(poses[tree, new, 2] - poses[other, k, 2]) % (2.0 * math.pi)
            d = math.hypot(poses[other, k, 0] - poses[tree, new, 0], poses[other, k, 1] - poses[tree, new, 1])
            d += 0.4 / phi * min(turn, 2.0 * math.pi - turn)
            place = found
            while place > 0 and near_d[place - 1] > d:
                place -= 1
            if place < _NEAREST:
                last = min(found, _NEAREST - 1)
                for m in range(last, place, -1):
                    near[m], near_d[m] = near[m - 1], near_d[m - 1]
                near[place], near_d[place] = k, d
                found = min(found + 1, _NEAREST)
        for m in range(found):
            a = new if tree == 0 else near[m]
            b = near[m] if tree == 0 else new
            shortest_word(poses[0, a], poses[1, b], phi, work_turns, work_lengths, bridge_turns, bridge_lengths)
            if reverse_run(bridge_lengths) <= max_reverse * phi + 1e-9 and word_is_free(
                values, resolution, x0, y0, poses[0, a, 0], poses[0, a, 1], poses[0, a, 2],
                bridge_turns, bridge_lengths, phi,
            ):  # fmt: skip
                joined_a, joined_b = a, b
                break
        if joined_a >= 0:
            break
    out_turns = np.zeros(MAX_SEGMENTS, np.int64)
    out_lengths = np.zeros(MAX_SEGMENTS)
    if joined_a < 0:
        return out_turns[:0], out_lengths[:0], used
    chain = np.empty(capacity, np.int64)
    n, k = 0, joined_a
    while k > 0:
        chain[n] = k
        n += 1
        k = parent[0, k]
    count = 0
    for m in range(n - 1, -1, -1):
        for k in range(SEGMENTS):
            if edge_lengths[0, chain[m], k] != 0.0 and count < MAX_SEGMENTS:
                out_turns[count], out_lengths[count] = edge_turns[0, chain[m], k], edge_lengths[0, chain[m], k] / phi
                count += 1
    for k in range(SEGMENTS):
        if bridge_lengths[k] != 0.0 and count < MAX_SEGMENTS:
            out_turns[count], out_lengths[count] = bridge_turns[k], bridge_lengths[k] / phi
            count += 1
    b = joined_b
    while b > 0:  # towards the goal the edges are driven backwards
        for k in range(SEGMENTS - 1, -1, -1):
            if edge_lengths[1, b, k] != 0.0 and count < MAX_SEGMENTS:
                out_turns[count], out_lengths[count] = edge_turns[1, b, k], -edge_lengths[1, b, k] / phi
                count += 1
        b = parent[1, b]
    if count >= MAX_SEGMENTS:
        count = 0
    return out_turns[:count], out_lengths[:count], used
