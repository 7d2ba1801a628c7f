"""J-linkage: which points prefer the same models (Toldo and Fusiello, ECCV 2008). Preference sets are bit rows."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel

WORD = 64


@kernel
def _bits_set(x: np.uint64) -> np.int64:
    """Number of set bits of a word, written so that the compiler uses one machine instruction."""
    x = x - ((x >> np.uint64(1)) & np.uint64(0x5555555555555555))
    x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
    x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def _common(words: NDArray[np.uint64], i: int, n: int, out: IntArray) -> None:
    """out[j] for j < n: number of models that rows i and j both prefer."""
    for j in range(n):
        out[j] = 0
    for w in range(words.shape[0]):
        mine = words[w, i]
        if mine == 0:
            continue
        others = words[w]
        for j in range(n):
            out[j] += _bits_set(others[j] & mine)


@kernel
def _all_common(words: NDArray[np.uint64]) -> tuple[NDArray[np.uint16], FloatArray]:
    """(N, N) number of models that two rows both prefer, 0 on the diagonal; and (N,) number each prefers."""
    n = words.shape[1]
    common, size, count = np.zeros((n, n), np.uint16), np.empty(n), np.empty(n, np.int64)
    for i in range(n):
        _common(words, i, i + 1, count)
        size[i] = count[i]
        for j in range(i):
            common[i, j] = count[j]
    for i in range(n):
        for j in range(i):
            common[j, i] = common[i, j]
    return common, size


@kernel
def _likeness(common: NDArray[np.uint16], size: FloatArray, own: float, out: FloatArray) -> None:
    """out[j]: |i and j| / |i or j| of a row i of size ``own``. Fractions of integers below 2^17 keep equality and order
    as float64."""
    for j in range(size.shape[0]):
        both = np.float64(common[j])
        out[j] = both / (own + size[j] - both)


@kernel
def first_largest(values: FloatArray) -> int:
    """Index of the first largest of values >= 0, -1 when all are 0. Compared as integers, which have the same order, so
    that the loop vectorises."""
    bits = values.view(np.int64)
    top = np.int64(0)
    for j in range(bits.shape[0]):
        top = max(top, bits[j])
    if top == 0:
        return -1
    j = 0
    while bits[j] != top:
        j += 1
    return j


@kernel
def _compact(
    words: NDArray[np.uint64], common: NDArray[np.uint16], size: FloatArray, bound: FloatArray, nearest: IntArray,
    stale: BoolArray, row: IntArray, n: int,
) -> int:  # fmt: skip
    """Move the rows that may still merge to the front, in their order; returns their number."""
    place = np.full(n, -1)
    m = 0
    for i in range(n):
        if bound[i] > 0.0:
            place[i] = m
            m += 1
    for w in range(words.shape[0]):
        for i in range(n):
            if place[i] >= 0:
                words[w, place[i]] = words[w, i]
    for i in range(n):
        a = place[i]
        if a < 0:
            continue
        for j in range(n):
            if place[j] >= 0:
                common[a, place[j]] = common[i, j]
        size[a], bound[a], stale[a], row[a] = size[i], bound[i], stale[i], row[i]
        nearest[a] = -1 if stale[i] else place[nearest[i]]
    return m


@kernel
def _reconsider(
    like: FloatArray, n: int, p: int, q: int, bound: FloatArray, nearest: IntArray, stale: BoolArray
) -> None:
    """Update the nearest of n rows after row q was merged into p; like: their similarity to p."""
    for j in range(n):
        if like[j] > bound[j] or (like[j] == bound[j] and not stale[j] and p <= nearest[j]):
            nearest[j], stale[j], bound[j] = p, False, like[j]
        elif nearest[j] == p or nearest[j] == q:
            stale[j] = True


@kernel
def agglomerate(preferences: NDArray[np.uint64]) -> IntArray:
    """Merge the two clusters of smallest Jaccard distance and intersect their sets, until all are disjoint.

    preferences: (N, W) uint64, at most 65535 bits a row. Returns (N,) the row that each was merged into, or itself. Of
    equally near pairs the first is taken. Exact: an intersection may be nearer to a third cluster, so every merged one
    is compared with all. A row whose nearest was merged keeps its similarity as a bound (stale). Its nearest is
    searched again only when no other row has a larger bound. Rows that are merged, or disjoint from all, are removed
    from time to time."""
    n = live = preferences.shape[0]
    into, row, words = np.arange(n), np.arange(n), preferences.T.copy()
    common, size = _all_common(words)
    nearest, stale = np.full(n, -1), np.ones(n, np.bool_)
    like, bound, count = np.empty(n), np.ones(n), np.empty(n, np.int64)
    while True:
        if 4 * live < 3 * n:
            live = n = _compact(words, common, size, bound, nearest, stale, row, n)
        p = first_largest(bound[:n])
        if p < 0:
            return into
        q = nearest[p]
        if not stale[p]:
            into[row[q]] = row[p]
            bound[q], size[q], live = 0.0, np.inf, live - 1
            for w in range(words.shape[0]):
                words[w, p] &= words[w, q]
            size[p] = common[p, q]
            _common(words, p, n, count)
            count[p] = 0
            common[p, :n] = count[:n]
            for j in range(n):
                common[j, p] = count[j]
        _likeness(common[p], size[:n], size[p], like)
        if not stale[p]:
            _reconsider(like, n, p, q, bound, nearest, stale)
        k = first_largest(like[:n])
        nearest[p], stale[p], bound[p] = k, False, like[k] if k >= 0 else 0.0
        live -= k < 0
