"""RRT-Connect over Reeds-Shepp words.

J. J. Kuffner, S. M. LaValle, "RRT-Connect", ICRA 2000; every extension is a motion of bounded curvature (paper 4.4).
A way is a list of segments: turn (+1 left, -1 right, 0 straight) and signed length [m].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import reverse_run, word_is_free
from vsx_ros.kernels.planning.reeds_shepp import SEGMENTS, Words, advance, room_for, shortest_word

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
def random_pose(field: DistanceField, open_cells: IntArray, state: NDArray[np.uint64], pose: FloatArray) -> None:
    """Fill pose (3,): somewhere in one of the cells, which are flat indices (M,), with any heading."""
    columns = field.values.shape[1]
    cell = open_cells[int(random_unit(state) * open_cells.shape[0])]
    pose[0] = field.origin_x + (cell % columns + random_unit(state)) * field.resolution
    pose[1] = field.origin_y + (cell // columns + random_unit(state)) * field.resolution
    pose[2] = (2.0 * random_unit(state) - 1.0) * math.pi


@kernel
def pose_distance(a: FloatArray, b: FloatArray, phi: float, below: float) -> float:
    """How far pose a (3,) is from b (3,) [m], a part of the turn included, unless it is not ``below`` anyway."""
    d: float = math.hypot(a[0] - b[0], a[1] - b[1])
    if d >= below:
        return d
    turn: float = abs(a[2] - b[2]) % (2.0 * math.pi)
    return d + 0.4 / phi * min(turn, 2.0 * math.pi - turn)


@kernel
def _truncate(lengths: FloatArray, most: float) -> None:
    """Cut a word (lengths in radii, changed in place) to a total of ``most`` radii."""
    left = most
    for k in range(SEGMENTS):
        size = abs(lengths[k])
        if size > left:
            lengths[k] *= left / size
        left = max(0.0, left - abs(lengths[k]))


class _Trees(NamedTuple):
    """From the start and from the goal: poses (2, N, 3), parents (2, N), and the words to them, turns (2, N, SEGMENTS)
    and lengths (2, N, SEGMENTS) in radii."""

    poses: FloatArray
    parents: IntArray
    turns: IntArray
    lengths: FloatArray


@kernel
def _extended(
    field: DistanceField, trees: _Trees, side: int, size: int, sample: FloatArray, phi: float, reach: float,
    max_reverse: float, word: Words,
) -> bool:  # fmt: skip
    """Extend one tree of a size from its nearest state towards a sample; False where that is not free."""
    poses = trees.poses[side]
    best, nearest = np.inf, 0
    for k in range(size):
        d = pose_distance(poses[k], sample, phi, best)
        if d < best:
            best, nearest = d, k
    shortest_word(poses[nearest], sample, phi, word)
    turns, lengths = word.turns[0], word.lengths[0]
    _truncate(lengths, reach * phi)
    x, y, theta = poses[nearest]
    if reverse_run(lengths if side == 0 else -lengths) > max_reverse * phi + 1e-9:
        return False
    if not word_is_free(field, x, y, theta, turns, lengths, phi):
        return False
    for k in range(SEGMENTS):
        x, y, theta = advance(x, y, theta, turns[k], lengths[k] / phi, phi)
    poses[size, 0], poses[size, 1], poses[size, 2] = x, y, theta
    trees.parents[side, size], trees.turns[side, size], trees.lengths[side, size] = nearest, turns, lengths
    return True


@kernel
def _nearest_few(poses: FloatArray, size: int, pose: FloatArray, phi: float, near: IntArray, away: FloatArray) -> int:
    """Fill near (F,), away (F,) with the states nearest to a pose (3,), nearest first; how many."""
    found = 0
    for k in range(size):
        d = pose_distance(poses[k], pose, phi, np.inf)
        place = found
        while place > 0 and away[place - 1] > d:
            place -= 1
        if place < near.shape[0]:
            for m in range(min(found, near.shape[0] - 1), place, -1):
                near[m], away[m] = near[m - 1], away[m - 1]
            near[place], away[place] = k, d
            found = min(found + 1, near.shape[0])
    return found


@kernel
def _append(turns: IntArray, lengths: FloatArray, count: int, word_turns: IntArray, word_lengths: FloatArray) -> int:
    """Append a word to a way as far as there is room; its number of segments."""
    for k in range(SEGMENTS):
        if word_lengths[k] != 0.0 and count < turns.shape[0]:
            turns[count], lengths[count] = word_turns[k], word_lengths[k]
            count += 1
    return count


@kernel
def _joined(trees: _Trees, a: int, b: int, bridge: Words, phi: float) -> tuple[IntArray, FloatArray]:
    """Turns (S,) and lengths (S,) [m] from the start to state a, over the bridge to b, and on to the goal; empty where
    they are too many."""
    turns, lengths = np.zeros(MAX_SEGMENTS, np.int64), np.zeros(MAX_SEGMENTS)
    chain = np.empty(trees.parents.shape[1], np.int64)
    n = count = 0
    while a > 0:
        chain[n] = a
        n += 1
        a = trees.parents[0, a]
    for m in range(n - 1, -1, -1):
        count = _append(turns, lengths, count, trees.turns[0, chain[m]], trees.lengths[0, chain[m]] / phi)
    count = _append(turns, lengths, count, bridge.turns[0], bridge.lengths[0] / phi)
    while b > 0:  # towards the goal the edges are driven backwards
        count = _append(turns, lengths, count, trees.turns[1, b][::-1], -trees.lengths[1, b][::-1] / phi)
        b = trees.parents[1, b]
    if count >= MAX_SEGMENTS:
        count = 0
    return turns[:count], lengths[:count]


@kernel
def rrt_connect(
    field: DistanceField, open_cells: IntArray, start: FloatArray, goal: FloatArray, phi: float, reach: float,
    max_reverse: float, seed: np.uint64, iterations: int,
) -> tuple[IntArray, FloatArray, int]:  # fmt: skip
    """A way from start (3,) to goal (3,) through the margin field, or none.

    open_cells (M,): flat indices of the cells to sample from. reach [m]: longest extension. max_reverse [m]: longest
    reverse leg within one extension. Returns turns (S,), lengths (S,) [m] (empty when not found) and iterations used.
    """
    capacity = iterations + 2
    trees = _Trees(
        np.empty((2, capacity, 3)), np.full((2, capacity), -1, np.int64),
        np.zeros((2, capacity, SEGMENTS), np.int64), np.zeros((2, capacity, SEGMENTS)),
    )  # fmt: skip
    sizes, poses = np.ones(2, np.int64), trees.poses
    poses[0, 0], poses[1, 0] = start, goal
    state, sample, word = np.array([seed], np.uint64), np.empty(3), room_for(1)
    near, away = np.empty(_NEAREST, np.int64), np.empty(_NEAREST)
    for iteration in range(iterations):
        side, new = iteration % 2, 0
        if iteration > 0:
            random_pose(field, open_cells, state, sample)
            new = sizes[side]
            if not _extended(field, trees, side, new, sample, phi, reach, max_reverse, word):
                continue
            sizes[side] += 1
        other = 1 - side
        for m in range(_nearest_few(poses[other], sizes[other], poses[side, new], phi, near, away)):
            a, b = (new, near[m]) if side == 0 else (near[m], new)
            shortest_word(poses[0, a], poses[1, b], phi, word)
            if reverse_run(word.lengths[0]) <= max_reverse * phi + 1e-9:
                x, y, theta = poses[0, a]
                if word_is_free(field, x, y, theta, word.turns[0], word.lengths[0], phi):
                    turns, lengths = _joined(trees, a, b, word, phi)
                    return turns, lengths, iteration + 1
    return np.zeros(0, np.int64), np.zeros(0), iterations
