"""Eliminates points from a bundle adjustment (Schur complement): the sparse system of the frames alone, and the points
that follow from its solution."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.linalg.frontal import elimination


class BundleObservations(NamedTuple):
    """O observations sorted by point: those of point p from start[p] on (M + 1,). point, frame (O,): which frame sees
    which point; xy (O, 2) undistorted px; weight (O,) = 2^-level."""

    start: IntArray
    point: IntArray
    frame: IntArray
    xy: FloatArray
    weight: FloatArray


class Blocks(NamedTuple):
    """A linearised adjustment: frame blocks H (n, 6, 6; upper), g (n, 6); point blocks V (M, 6; upper, by rows), gp
    (M, 3), and L (M, 6) their Cholesky factors; mixed blocks W (O, 3, 6), NaN for outliers."""

    H: FloatArray
    g: FloatArray
    V: FloatArray
    gp: FloatArray
    W: FloatArray
    L: FloatArray


@kernel
def room_for(n: int, points: int, observations: int) -> Blocks:
    """Blocks for n free frames, points and observations."""
    L, W = np.zeros((points, 6)), np.empty((observations, 3, 6))
    return Blocks(
        H=np.zeros((n, 6, 6)), g=np.zeros((n, 6)), V=np.zeros((points, 6)), gp=np.zeros((points, 3)), W=W, L=L
    )


class Pattern(NamedTuple):
    """Where the system of n frames has blocks. number (F,): a frame's row in the order of elimination, -1 when it is
    fixed; block (n, n): number of the block in a row and column of the upper triangle, -1 where there is none; begin,
    column, entry, extent: see ``frontal.solve``."""

    number: IntArray
    block: Int32Array
    begin: IntArray
    column: IntArray
    entry: IntArray
    extent: IntArray


@kernel
def _tie(i: int, j: int, tied: BoolArray) -> None:
    if i >= 0 and j >= 0:
        tied[min(i, j), max(i, j)] = True


@kernel
def pattern_of(free: IntArray, observed: BundleObservations, factor_a: IntArray, factor_b: IntArray) -> Pattern:
    """The ``Pattern`` of frames that are tied by points or factors. free (F,): 0..n-1, or -1 for fixed frames."""
    n = 0
    for f in range(free.shape[0]):
        n = max(n, free[f] + 1)
    tied = np.zeros((n, n), np.bool_)
    start, frame = observed.start, observed.frame
    for p in range(start.shape[0] - 1):
        for o in range(start[p], start[p + 1]):
            for q in range(o + 1, start[p + 1]):
                _tie(free[frame[o]], free[frame[q]], tied)
    for f in range(factor_a.shape[0]):
        _tie(free[factor_a[f]], free[factor_b[f]], tied)
    order, entry, extent = elimination(tied)
    position = np.empty(n, np.int64)
    for k in range(n):
        position[order[k]] = k
    number = free.astype(np.int64)
    for f in range(free.shape[0]):
        if free[f] >= 0:
            number[f] = position[free[f]]
    for k in range(n):
        entry[k] = position[entry[k]]
    index, begin = np.full((n, n), -1, np.int32), np.zeros(n + 1, np.int64)
    column = np.empty(n + np.count_nonzero(tied), np.int64)
    count = 0
    for k in range(n):
        for j in range(k, n):
            a, b = min(order[k], order[j]), max(order[k], order[j])
            if a == b or tied[a, b]:
                index[k, j], column[count] = count, j
                count += 1
        begin[k + 1] = count
    return Pattern(number=number, block=index, begin=begin, column=column[:count], entry=entry, extent=extent)


@kernel
def _factor_point(V: FloatArray, damping: float, L: FloatArray) -> bool:
    """Lower Cholesky factor (6 entries by columns, the diagonal's inverted) of a damped symmetric 3x3 (6 upper entries
    by rows); False when it is singular."""
    grow = 1.0 + damping
    a, d, f = V[0] * grow + 1e-12, V[3] * grow + 1e-12, V[5] * grow + 1e-12
    l0 = 1.0 / math.sqrt(a)
    l1, l2 = V[1] * l0, V[2] * l0
    d1 = d - l1 * l1
    if not d1 > 1e-14 * d:
        return False
    l3 = 1.0 / math.sqrt(d1)
    l4 = (V[4] - l1 * l2) * l3
    f1 = f - l2 * l2 - l4 * l4
    if not f1 > 1e-14 * f:
        return False
    L[0], L[1], L[2], L[3], L[4], L[5] = l0, l1, l2, l3, l4, 1.0 / math.sqrt(f1)
    return True


@kernel
def _forward(
    l0: float, l1: float, l2: float, l3: float, l4: float, l5: float, a: float, b: float, c: float
) -> tuple[float, float, float]:
    """(a, b, c) divided by a factor of ``_factor_point``."""
    y0 = a * l0
    y1 = (b - l1 * y0) * l3
    return y0, y1, (c - l2 * y0 - l4 * y1) * l5


@kernel
def _members(number: IntArray, obs_frame: IntArray, W: FloatArray, first: int, beyond: int, members: IntArray) -> int:
    """Fill members with the inlier observations of one point in free frames, in the order of elimination."""
    count = 0
    for o in range(first, beyond):
        i = number[obs_frame[o]]
        if i < 0 or np.isnan(W[o, 0, 0]):
            continue
        k = count
        while k > 0 and number[obs_frame[members[k - 1]]] > i:
            members[k] = members[k - 1]
            k -= 1
        members[k] = o
        count += 1
    return count


@kernel
def reduce_points(
    pattern: Pattern, observed: BundleObservations, linear: Blocks, damping: float, blocks: FloatArray, rhs: FloatArray
) -> None:
    """Subtract the points' share from the system's blocks and from rhs (n, 6); fill L."""
    _, _, V, gp, W, L = linear
    obs_start, obs_frame = observed.start, observed.frame
    longest = 1
    for p in range(V.shape[0]):
        longest = max(longest, obs_start[p + 1] - obs_start[p])
    members, at, Z = np.empty(longest, np.int64), np.empty(longest, np.int64), np.empty((longest, 3, 6))
    for p in range(V.shape[0]):
        if not _factor_point(V[p], damping, L[p]):
            L[p, 0] = np.nan
            continue
        l0, l1, l2, l3, l4, l5 = L[p, 0], L[p, 1], L[p, 2], L[p, 3], L[p, 4], L[p, 5]
        y0, y1, y2 = _forward(l0, l1, l2, l3, l4, l5, gp[p, 0], gp[p, 1], gp[p, 2])
        count = _members(pattern.number, obs_frame, W, obs_start[p], obs_start[p + 1], members)
        for k in range(count):
            o = members[k]
            at[k] = pattern.number[obs_frame[o]]
            for a in range(6):
                z0, z1, z2 = _forward(l0, l1, l2, l3, l4, l5, W[o, 0, a], W[o, 1, a], W[o, 2, a])
                Z[k, 0, a], Z[k, 1, a], Z[k, 2, a] = z0, z1, z2
                rhs[at[k], a] -= z0 * y0 + z1 * y1 + z2 * y2
        for m in range(count):
            # Written out, these loads stay outside of the loop over k: saves a tenth of the adjustment.
            a0, a1, a2, a3, a4, a5 = Z[m, 0, 0], Z[m, 0, 1], Z[m, 0, 2], Z[m, 0, 3], Z[m, 0, 4], Z[m, 0, 5]
            b0, b1, b2, b3, b4, b5 = Z[m, 1, 0], Z[m, 1, 1], Z[m, 1, 2], Z[m, 1, 3], Z[m, 1, 4], Z[m, 1, 5]
            c0, c1, c2, c3, c4, c5 = Z[m, 2, 0], Z[m, 2, 1], Z[m, 2, 2], Z[m, 2, 3], Z[m, 2, 4], Z[m, 2, 5]
            for k in range(m + 1):
                block = blocks[pattern.block[at[k], at[m]]]
                for a in range(6):
                    z0, z1, z2 = Z[k, 0, a], Z[k, 1, a], Z[k, 2, a]
                    block[a, 0] -= z0 * a0 + z1 * b0 + z2 * c0
                    block[a, 1] -= z0 * a1 + z1 * b1 + z2 * c1
                    block[a, 2] -= z0 * a2 + z1 * b2 + z2 * c2
                    block[a, 3] -= z0 * a3 + z1 * b3 + z2 * c3
                    block[a, 4] -= z0 * a4 + z1 * b4 + z2 * c4
                    block[a, 5] -= z0 * a5 + z1 * b5 + z2 * c5


@kernel
def back_substitute(
    number: IntArray,
    observed: BundleObservations,
    linear: Blocks,
    step: FloatArray,
    points: FloatArray,
    moved: FloatArray,
) -> None:
    """Fill moved (M, 3) with the points after the step that follows from the frames' step (n, 6)."""
    _, _, _, gp, W, L = linear
    for p in range(points.shape[0]):
        moved[p, 0], moved[p, 1], moved[p, 2] = points[p, 0], points[p, 1], points[p, 2]
        if np.isnan(L[p, 0]):
            continue
        b0, b1, b2 = gp[p, 0], gp[p, 1], gp[p, 2]
        for o in range(observed.start[p], observed.start[p + 1]):
            i = number[observed.frame[o]]
            if i < 0 or np.isnan(W[o, 0, 0]):
                continue
            for a in range(6):
                s = step[i, a]
                b0 -= W[o, 0, a] * s
                b1 -= W[o, 1, a] * s
                b2 -= W[o, 2, a] * s
        l0, l1, l2, l3, l4, l5 = L[p, 0], L[p, 1], L[p, 2], L[p, 3], L[p, 4], L[p, 5]
        y0, y1, y2 = _forward(l0, l1, l2, l3, l4, l5, b0, b1, b2)
        x2 = y2 * l5
        x1 = (y1 - l4 * x2) * l3
        moved[p, 0] += (y0 - l1 * x1 - l2 * x2) * l0
        moved[p, 1] += x1
        moved[p, 2] += x2
