"""Sparse Cholesky solution of systems of 6 x 6 blocks by the frontal method (Irons, Int. J. Numer. Meth. Eng. 2, 1970).

Frames are eliminated one after another in an order that keeps the front small (King, Int. J. Numer. Meth. Eng. 2,
1970). The front is the set of frames not yet eliminated but tied to an eliminated one. Along a path its width is the
range of view, whatever the length of the path. Each elimination is a dense update of the front alone."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def _next(front: IntArray, waiting: int, entered: IntArray, fresh: IntArray) -> int:
    """Place in the front of the frame that brings the fewest new ones; among equals, the one that waits longest."""
    best = 0
    for k in range(1, waiting):
        v, b = front[k], front[best]
        if fresh[v] < fresh[b] or (fresh[v] == fresh[b] and entered[v] < entered[b]):
            best = k
    return best


@kernel
def _least_tied(entered: IntArray, fresh: IntArray) -> int:
    """The frame to begin with: the one with the fewest neighbours, of those that have not entered."""
    best = -1
    for v in range(entered.shape[0]):
        if entered[v] < 0 and (best < 0 or fresh[v] < fresh[best]):
            best = v
    return best


@kernel
def _neighbours(tied: BoolArray) -> tuple[IntArray, IntArray]:
    """The ties (n, n; upper triangle) as lists: those of v are list[begin[v] : begin[v + 1]]."""
    n = tied.shape[0]
    begin = np.zeros(n + 1, np.int64)
    for i in range(n):
        for j in range(i + 1, n):
            if tied[i, j]:
                begin[i + 1] += 1
                begin[j + 1] += 1
    for i in range(n):
        begin[i + 1] += begin[i]
    lists, filled = np.empty(begin[n], np.int64), begin[:n].copy()
    for i in range(n):
        for j in range(i + 1, n):
            if tied[i, j]:
                lists[filled[i]], lists[filled[j]] = j, i
                filled[i] += 1
                filled[j] += 1
    return begin, lists


@kernel
def elimination(tied: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Order in which to eliminate n frames. tied (n, n) bool: which are tied; only its upper triangle is read.

    Returns order (n,): the frame eliminated at each step; entry (n,): the frames as they enter the front; extent (n,):
    width of the front at each step. The last frame of the front takes the place of the eliminated one."""
    n = tied.shape[0]
    begin, neighbours = _neighbours(tied)
    fresh, entered = begin[1:] - begin[:-1], np.full(n, -1)
    order, entry, extent = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    front = np.empty(n, np.int64)
    waiting, count = 0, 0
    for step in range(n):
        chosen = _next(front, waiting, entered, fresh) if waiting else -1
        v = front[chosen] if waiting else _least_tied(entered, fresh)
        for q in range(begin[v] - 1, begin[v + 1]):
            u = neighbours[q] if q >= begin[v] else v
            if entered[u] >= 0:
                continue
            front[waiting], entry[count], entered[u] = u, u, count
            waiting += 1
            count += 1
            for m in range(begin[u], begin[u + 1]):
                fresh[neighbours[m]] -= 1
        order[step], extent[step] = v, waiting
        waiting -= 1
        front[max(chosen, 0)] = front[waiting]
    return order, entry, extent


@kernel
def _gather(front: FloatArray, s: int, panel: FloatArray) -> None:
    """Fill panel (6, E) with rows s..s+5 of the symmetric front, whose upper triangle is kept."""
    e = panel.shape[1]
    for a in range(6):
        for c in range(s + a):
            panel[a, c] = front[c, s + a]
        for c in range(s + a, e):
            panel[a, c] = front[s + a, c]


@kernel
def _factor_rows(panel: FloatArray, s: int, diagonal: FloatArray) -> bool:
    """Upper Cholesky factor (6, 6) of the panel's columns s..s+5, and the panel's other columns divided by it."""
    e = panel.shape[1]
    for a in range(6):
        pivot = panel[a, s + a]
        if not pivot > 1e-12:
            return False
        inverse = 1.0 / math.sqrt(pivot)
        row = panel[a]
        for c in range(e):
            row[c] *= inverse
        for b in range(a + 1, 6):
            f, other = row[s + b], panel[b]
            for c in range(e):
                other[c] -= f * row[c]
    for a in range(6):
        for b in range(6):
            diagonal[a, b] = panel[a, s + b] if b >= a else 0.0
            panel[a, s + b] = 0.0
    return True


@kernel
def _update(front: FloatArray, panel: FloatArray) -> None:
    """front -= panel^T panel, upper triangle."""
    e = panel.shape[1]
    for r in range(e):
        f0, f1, f2, f3, f4, f5 = panel[0, r], panel[1, r], panel[2, r], panel[3, r], panel[4, r], panel[5, r]
        row = front[r, r:e]
        # Slices are indexed from zero: with an offset in the index the loop is not vectorised.
        p0, p1, p2, p3, p4, p5 = panel[0, r:], panel[1, r:], panel[2, r:], panel[3, r:], panel[4, r:], panel[5, r:]
        for c in range(e - r):
            row[c] -= f0 * p0[c] + f1 * p1[c] + f2 * p2[c] + f3 * p3[c] + f4 * p4[c] + f5 * p5[c]


@kernel
def _forward(panel: FloatArray, s: int, diagonal: FloatArray, b: FloatArray, carried: FloatArray) -> None:
    """Overwrite b (6,) with the half-solved values of the frame in place s, and subtract their share from carried."""
    for i in range(6):
        value = b[i] + carried[s + i]
        for j in range(i):
            value -= diagonal[j, i] * b[j]
        b[i] = value / diagonal[i, i]
    for i in range(6):
        for c in range(panel.shape[1]):
            carried[c] -= panel[i, c] * b[i]


@kernel
def _close_gap(front: FloatArray, carried: FloatArray, s: int, last: int) -> None:
    """Move rows and columns last..last+5 of front and carried to s..s+5, and leave zeros there."""
    for a in range(6):
        carried[s + a] = carried[last + a]
        carried[last + a] = 0.0
        for c in range(last + a + 1):
            value = front[c, last + a]
            front[c, last + a] = 0.0
            if s == last:
                continue
            if c < s:
                front[c, s + a] = value
            elif c >= last:
                front[s + c - last, s + a] = value
            elif c >= s + 6:
                front[s + a, c] = value


@kernel
def solve(
    blocks: FloatArray, begin: IntArray, column: IntArray, entry: IntArray, extent: IntArray, b: FloatArray
) -> bool:
    """Overwrite b (n, 6) with the solution of S x = b; False when S is not positive definite.

    All frames are numbered in the order of elimination: row k of S's upper triangle are blocks (B, 6, 6)
    begin[k]..begin[k + 1], the diagonal first, in the columns ``column`` (B,). entry, extent: see ``elimination``."""
    n, widest = extent.shape[0], 0
    room = np.zeros(n + 1, np.int64)
    for k in range(n):
        widest = max(widest, extent[k])
        room[k + 1] = room[k] + 36 * extent[k]
    front, carried = np.zeros((6 * widest, 6 * widest)), np.zeros(6 * widest)
    factor, diagonal = np.empty(room[n]), np.empty((n, 6, 6))
    place, occupant = np.zeros(n, np.int64), np.zeros(widest, np.int64)
    waiting, count = 0, 0
    for k in range(n):
        while waiting < extent[k]:
            place[entry[count]], occupant[waiting] = waiting, entry[count]
            waiting += 1
            count += 1
        s, last = 6 * place[k], 6 * (waiting - 1)
        panel = factor[room[k] : room[k + 1]].reshape(6, 6 * waiting)
        _gather(front, s, panel)
        for q in range(begin[k], begin[k + 1]):
            at = 6 * place[column[q]]
            for i in range(6):
                for j in range(6):
                    panel[i, at + j] += blocks[q, i, j]
        if not _factor_rows(panel, s, diagonal[k]):
            return False
        _forward(panel, s, diagonal[k], b[k], carried)
        _update(front, panel)
        _close_gap(front, carried, s, last)
        waiting -= 1
        occupant[place[k]] = occupant[waiting]
        place[occupant[waiting]] = place[k]
    _back(factor, room, diagonal, place, b)
    return True


@kernel
def _back(factor: FloatArray, room: IntArray, diagonal: FloatArray, place: IntArray, b: FloatArray) -> None:
    """Second half of ``solve``: the frames' values in reverse order, with the places of the front as before."""
    n = b.shape[0]
    known = np.zeros(((room[1:] - room[:-1]) // 6).max())
    for k in range(n - 1, -1, -1):
        panel = factor[room[k] : room[k + 1]].reshape(6, (room[k + 1] - room[k]) // 6)
        s, last = 6 * place[k], panel.shape[1] - 6
        for i in range(6):
            known[last + i] = known[s + i]
        for i in range(5, -1, -1):
            value = b[k, i]
            for c in range(panel.shape[1]):
                value -= panel[i, c] * known[c]
            for j in range(i + 1, 6):
                value -= diagonal[k, i, j] * b[k, j]
            b[k, i] = value / diagonal[k, i, i]
        for i in range(6):
            known[s + i] = b[k, i]
