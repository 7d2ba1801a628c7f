"""Shortcuts: parts of a way replaced by Reeds-Shepp words.

A way is a list of segments: turn (+1 left, -1 right, 0 straight) and signed length [m]."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import reverse_run, word_is_free
from vsx_ros.kernels.planning.reeds_shepp import SEGMENTS, advance, room_for, shortest_word

SEGMENT_COST_M = 0.01  # many short arcs around a corner are hardly shorter than few, but harder to smooth
_NEAR_M = 0.5  # shortest part that is replaced on purpose
MAX_SEGMENTS = 512  # of a way; one with more is not shortened


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
def way_cost(lengths: FloatArray, cusp_cost: float) -> float:
    """Length [m] plus a price [m] for every change of direction, and a small one for every segment."""
    total, sign = 0.0, 0.0
    for k in range(lengths.shape[0]):
        if lengths[k] != 0.0:
            total += abs(lengths[k]) + SEGMENT_COST_M
            if sign * lengths[k] < 0.0:
                total += cusp_cost
            sign = lengths[k]
    return total


@kernel
def shorten(
    field: DistanceField, start: FloatArray, turns: IntArray, lengths: FloatArray, phi: float, max_reverse: float,
    cusp_cost: float, seed: np.uint64, tries: int,
) -> tuple[IntArray, FloatArray]:  # fmt: skip
    """A way with parts replaced by Reeds-Shepp words where that is cheaper and free; same start and end.

    turns (S,), lengths (S,) [m]. The longest reverse leg is kept below max_reverse [m] or at least not made longer.
    Returns new turns and lengths."""
    state = np.array([seed], np.uint64)
    way_turns = np.zeros(MAX_SEGMENTS, np.int64)
    way_lengths = np.zeros(MAX_SEGMENTS)
    n: int = turns.shape[0]
    way_turns[:n], way_lengths[:n] = turns, lengths
    word = room_for(1)
    word_turns, word_lengths = word.turns[0], word.lengths[0]
    most = MAX_SEGMENTS + SEGMENTS + 2  # a word and two cut segments are added before the size is checked
    new_turns, new_lengths = np.zeros(most, np.int64), np.zeros(most)
    ends = np.empty((2, 3))
    cost = way_cost(way_lengths[:n], cusp_cost)
    run = reverse_run(way_lengths[:n])
    at = np.empty((MAX_SEGMENTS + 1, 3))  # where every segment begins
    total, changed = 0.0, True
    for attempt in range(tries):
        if changed:
            changed, total = False, 0.0
            x, y, theta = start[0], start[1], start[2]
            at[0, 0], at[0, 1], at[0, 2] = x, y, theta
            for k in range(n):
                total += abs(way_lengths[k])
                x, y, theta = advance(x, y, theta, way_turns[k], way_lengths[k], phi)
                at[k + 1, 0], at[k + 1, 1], at[k + 1, 2] = x, y, theta
        first, second = random_unit(state) * total, random_unit(state) * total
        if attempt == 0:
            first, second = 0.0, total
        if second < first:
            first, second = second, first
        if attempt % 8 == 1:
            second = total
        elif attempt % 8 == 2:
            first = 0.0
        elif attempt % 2 == 1:  # near places, at all scales: of a long way most others are not in sight of each other
            second = min(total, first + _NEAR_M * (total / _NEAR_M) ** random_unit(state))
        if second - first < 0.05:
            continue
        # The segments at both places.
        s, count = 0.0, 0
        before, after, before_part, after_part = 0, n, 0.0, 0.0
        for k in range(n):
            size = abs(way_lengths[k])
            if s <= first < s + size:
                before, before_part = k, first - s
            if s < second <= s + size + (1e-9 if k == n - 1 else 0.0):
                after, after_part = k, min(second - s, size)
            s += size
        if before == after and way_turns[before] == 0:
            continue  # nothing is shorter than a straight line
        if after == n:
            continue
        for end, k, part in ((0, before, before_part), (1, after, after_part)):
            signed = part if way_lengths[k] > 0.0 else -part
            x, y, theta = advance(at[k, 0], at[k, 1], at[k, 2], way_turns[k], signed, phi)
            ends[end, 0], ends[end, 1], ends[end, 2] = x, y, theta
        # The replaced length plus the cost of all changes of direction: a longer word is no gain.
        below = second - first + cost - total
        if shortest_word(ends[0], ends[1], phi, word, below) == np.inf:
            continue
        for k in range(before):
            new_turns[count], new_lengths[count] = way_turns[k], way_lengths[k]
            count += 1
        if before_part > 1e-9:
            new_turns[count] = way_turns[before]
            new_lengths[count] = before_part if way_lengths[before] > 0.0 else -before_part
            count += 1
        for k in range(SEGMENTS):
            if word_lengths[k] != 0.0:
                new_turns[count], new_lengths[count] = word_turns[k], word_lengths[k] / phi
                count += 1
        rest = abs(way_lengths[after]) - after_part
        if rest > 1e-9:
            new_turns[count] = way_turns[after]
            new_lengths[count] = rest if way_lengths[after] > 0.0 else -rest
            count += 1
        if count + n - after - 1 >= MAX_SEGMENTS - SEGMENTS - 2:
            continue
        for k in range(after + 1, n):
            new_turns[count], new_lengths[count] = way_turns[k], way_lengths[k]
            count += 1
        new_cost = way_cost(new_lengths[:count], cusp_cost)
        new_run = reverse_run(new_lengths[:count])
        if (
            new_cost < cost - 1e-6
            and new_run <= max(max_reverse, run) + 1e-9
            and word_is_free(field, ends[0, 0], ends[0, 1], ends[0, 2], word_turns, word_lengths, phi)
        ):
            # Join neighbours with the same turn and direction.
            n = 0
            for k in range(count):
                if n > 0 and way_turns[n - 1] == new_turns[k] and way_lengths[n - 1] * new_lengths[k] > 0.0:
                    way_lengths[n - 1] += new_lengths[k]
                else:
                    way_turns[n], way_lengths[n] = new_turns[k], new_lengths[k]
                    n += 1
            cost, run = way_cost(way_lengths[:n], cusp_cost), reverse_run(way_lengths[:n])
            changed = True
    return way_turns[:n].copy(), way_lengths[:n].copy()
