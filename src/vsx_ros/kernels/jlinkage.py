"""J-linkage: which points prefer the same models (Toldo and Fusiello, ECCV 2008). Preference sets are bit rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsx_ros.kernels import kernel

WORD = 64


@kernel
def _bits_set(x: Any) -> Any:
    """How many bits of a word are one; written so that the compiler knows it for one machine instruction."""
    x = x - ((x >> np.uint64(1)) & np.uint64(0x5555555555555555))
    x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
    x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def _common(a: Any, b: Any) -> Any:
    """Models that both rows prefer."""
    count = 0
    for w in range(a.shape[0]):
        count += _bits_set(a[w] & b[w])
    return count


@kernel
def _nearest(common: Any, size: Any, alive: Any, i: int) -> int:
    """The living row j != i of largest |i and j| / |i or j|, the first of equals; -1 when all are disjoint."""
    best, best_common, best_union = -1, np.int64(0), np.int64(1)
    for j in range(size.shape[0]):
        both = np.int64(common[i, j])
        if both == 0 or j == i or not alive[j]:
            continue
        union = size[i] + size[j] - both
        if both * best_union > best_common * union:
            best, best_common, best_union = j, both, union
    return best


@kernel
def agglomerate(preferences: Any) -> Any:
    """Merge the two clusters of smallest Jaccard distance, intersect their sets, until all are disjoint.

    preferences: (N, W) uint64, at most 65535 bits a row; overwritten. Returns (N,) the row that each was merged into,
    itself where it was not. Exact: the intersection may bring a cluster nearer to a third one, so each row keeps its
    nearest, which is looked for again when that one was merged, and compared with every merged one. Distances are
    compared as fractions of integers; of equally near pairs the first is taken.
    """
    n = preferences.shape[0]
    size = np.empty(n, np.int64)
    common = np.zeros((n, n), np.uint16)
    alive = np.ones(n, np.bool_)
    into = np.arange(n)
    for i in range(n):
        size[i] = _common(preferences[i], preferences[i])
        for j in range(i):
            common[i, j] = common[j, i] = _common(preferences[i], preferences[j])
    nearest = np.empty(n, np.int64)
    for i in range(n):
        nearest[i] = _nearest(common, size, alive, i)
    while True:
        p, best_common, best_union = -1, np.int64(0), np.int64(1)
        for i in range(n):
            if not alive[i] or nearest[i] < 0:
                continue
            both = np.int64(common[i, nearest[i]])
            union = size[i] + size[nearest[i]] - both
            if both * best_union > best_common * union:
                p, best_common, best_union = i, both, union
        if p < 0:
            return into
        q = nearest[p]
        alive[q], into[q] = False, p
        for w in range(preferences.shape[1]):
            preferences[p, w] &= preferences[q, w]
        size[p] = best_common
        for j in range(n):
            if alive[j] and j != p and common[p, j] > 0:
                common[p, j] = common[j, p] = _common(preferences[p], preferences[j])
        nearest[p] = _nearest(common, size, alive, p)
        for j in range(n):
            if not alive[j] or j == p:
                continue
            old = nearest[j]
            if old in (p, q):
                nearest[j] = _nearest(common, size, alive, j)
            elif common[p, j] > 0:
                both, union = np.int64(common[p, j]), size[p] + size[j] - common[p, j]
                old_both = np.int64(common[j, old])
                old_union = size[j] + size[old] - old_both
                nearer, farther = both * old_union, old_both * union
                if nearer > farther or (nearer == farther and p < old):
                    nearest[j] = p
