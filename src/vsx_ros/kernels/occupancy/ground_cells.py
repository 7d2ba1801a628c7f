"""Combines the scans of all keyframes: how far they reach, which cells of the grid they pass and hit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray, Points2
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.ground_map import PolarScans

_MARGIN_M = 0.5  # of unknown ground around what was seen, for views and for the corridor
_FIXED_BITS = 24  # fraction bits of 64, in cells: a ray of 1e6 cells errs by less than a tenth of one
_FIXED = float(1 << _FIXED_BITS)  # Rays step in fixed point: integers need no rounding at every cell


class Lattice(NamedTuple):
    """Rows and columns of a grid whose origin is a whole number of cells away from the world's."""

    rows: int
    columns: int
    resolution: float
    origin_x: float
    origin_y: float

    @staticmethod
    def around(points: Points2, resolution: float) -> Lattice:
        """The smallest lattice with a margin around (N, 2) points; around the origin if there are none."""
        points = np.vstack([points, np.zeros((0 if len(points) else 1, 2))])
        low = np.floor((points.min(axis=0) - _MARGIN_M) / resolution).astype(int)
        high = np.ceil((points.max(axis=0) + _MARGIN_M) / resolution).astype(int)
        columns, rows = (high - low).tolist()
        origin_x, origin_y = (low * resolution).tolist()
        return Lattice(rows, columns, resolution, origin_x=origin_x, origin_y=origin_y)

    def centres(self) -> tuple[FloatArray, FloatArray]:
        """x of each column (1, columns) and y of each row (rows, 1) [m]."""
        x = self.origin_x + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.resolution
        y = self.origin_y + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.resolution
        return x[None, :], y[:, None]


class Counts(NamedTuple):
    """(rows, columns) int32 each: observations of obstacle points in each cell, and points with enough of them."""

    votes: Int32Array
    members: Int32Array


@kernel
def count_hits(points: FloatArray, obs_point: Int32Array, hit: Float32Array, enough: int, lattice: Lattice) -> Counts:
    """Count observations (O,) of points (M, 3) with a positive hit (O,), and points with ``enough`` of them."""
    votes = np.zeros((lattice.rows, lattice.columns), np.int32)
    members = np.zeros_like(votes)
    counted = np.zeros(points.shape[0], np.int32)
    for o in range(obs_point.shape[0]):
        if hit[o] <= 0.0:
            continue
        p = obs_point[o]
        column = math.floor((points[p, 0] - lattice.origin_x) / lattice.resolution)
        row = math.floor((points[p, 1] - lattice.origin_y) / lattice.resolution)
        if 0 <= row < lattice.rows and 0 <= column < lattice.columns:
            votes[row, column] += 1
            counted[p] += 1
            if counted[p] == enough:
                members[row, column] += 1
    return Counts(votes, members)


@kernel
def height_range(
    points: FloatArray, obs_point: Int32Array, hit: Float32Array, enough: int, lattice: Lattice
) -> FloatArray:
    """(2, rows, columns) least and greatest height [m] of the points that ``count_hits`` counts as members of a cell;
    1e3 and -1e3 where there is none."""
    found = np.empty((2, lattice.rows, lattice.columns))
    found[0], found[1] = 1e3, -1e3
    counted = np.zeros(points.shape[0], np.int32)
    for o in range(obs_point.shape[0]):
        if hit[o] <= 0.0:
            continue
        p = obs_point[o]
        counted[p] += 1
        if counted[p] != enough:
            continue
        column = math.floor((points[p, 0] - lattice.origin_x) / lattice.resolution)
        row = math.floor((points[p, 1] - lattice.origin_y) / lattice.resolution)
        if 0 <= row < lattice.rows and 0 <= column < lattice.columns:
            found[0, row, column] = min(found[0, row, column], points[p, 2])
            found[1, row, column] = max(found[1, row, column], points[p, 2])
    return found


@kernel
def cover_discs(poses: FloatArray, keyframe: IntArray, radius: float, lattice: Lattice) -> Int32Array:
    """(rows, columns) the greatest keyframe (N,) of the poses (N, 2) within radius [m] of the middle of a cell; -1
    where there is none."""
    rows, columns, resolution, origin_x, origin_y = lattice
    covered = np.full((rows, columns), -1, np.int32)
    reach = int(radius / resolution) + 2
    for i in range(poses.shape[0]):
        x, y = poses[i, 0] - origin_x, poses[i, 1] - origin_y
        row, column = math.floor(y / resolution), math.floor(x / resolution)
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            dy = (r + 0.5) * resolution - y
            for c in range(max(0, column - reach), min(columns, column + reach + 1)):
                dx = (c + 0.5) * resolution - x
                if dx * dx + dy * dy <= radius * radius:
                    covered[r, c] = max(covered[r, c], keyframe[i])
    return covered


@kernel
def newer_than(
    points: FloatArray, obs_keyframe: Int32Array, obs_point: Int32Array, keyframe: Int32Array, lattice: Lattice
) -> BoolArray:
    """(O,) whether each observation of points (M, 3) is by a later keyframe than that of its point's cell in keyframe
    (rows, columns); False where that is negative."""
    newer = np.zeros(obs_point.shape[0], np.bool_)
    for o in range(obs_point.shape[0]):
        column = math.floor((points[obs_point[o], 0] - lattice.origin_x) / lattice.resolution)
        row = math.floor((points[obs_point[o], 1] - lattice.origin_y) / lattice.resolution)
        if 0 <= row < lattice.rows and 0 <= column < lattice.columns:
            newer[o] = 0 <= keyframe[row, column] < obs_keyframe[o]
    return newer


@kernel
def half_bearings(n_bearings: int) -> FloatArray:
    """(2 * n_bearings, 2) cosine and sine of the edges and the middles of bins, alternating."""
    table = np.empty((2 * n_bearings, 2))
    for h in range(2 * n_bearings):
        angle = h * math.pi / n_bearings
        table[h, 0], table[h, 1] = math.cos(angle), math.sin(angle)
    return table


@kernel
def _hold(corners: FloatArray, x: float, y: float) -> None:
    """Extend corners (2, 2), least and greatest x and y, to include a place."""
    corners[0, 0], corners[0, 1] = min(corners[0, 0], x), min(corners[0, 1], y)
    corners[1, 0], corners[1, 1] = max(corners[1, 0], x), max(corners[1, 1], y)


@kernel
def scan_corners(scans: PolarScans, points: FloatArray, obs_point: Int32Array) -> FloatArray:
    """(2, 2) least and greatest x and y [m] of camera centres, ends of their scans, and hit points."""
    positions, headings, free = scans.positions, scans.headings, scans.free
    corners = np.array([[np.inf, np.inf], [-np.inf, -np.inf]])
    for o in range(obs_point.shape[0]):
        if scans.hit[o] > 0.0:
            _hold(corners, points[obs_point[o], 0], points[obs_point[o], 1])
    n = free.shape[1]
    table = half_bearings(n)
    for k in range(free.shape[0]):
        c, s = headings[k]
        _hold(corners, positions[k, 0], positions[k, 1])
        for b in range(n):
            reach = max(free[k, b], scans.farther[k, b, 1]) if k < scans.farther.shape[0] else free[k, b]
            if reach > 0.0:
                x = positions[k, 0] + reach * (c * table[2 * b + 1, 0] - s * table[2 * b + 1, 1])
                y = positions[k, 1] + reach * (s * table[2 * b + 1, 0] + c * table[2 * b + 1, 1])
                _hold(corners, x, y)
    return corners


@kernel
def count_free(scans: PolarScans, lattice: Lattice) -> Int32Array:
    """(rows, columns) int32: how many keyframes' scans pass through each cell.

    Near the camera rays are denser than cells. There one ray serves two or four bins, as far as all of them are free;
    the number of bins is a multiple of four. Rays that begin farther off serve one bin each."""
    positions, headings = scans.positions, scans.headings
    free, begin, farther = scans.free, scans.begin, scans.farther
    rows, columns, resolution, origin_x, origin_y = lattice
    # Lower half of each word: the count; upper half: the keyframe that counted last.
    votes = np.zeros((rows, columns), np.int64)
    n = free.shape[1]
    table = half_bearings(n)
    # Rays 0.8 cells apart, and points half a cell apart on each, miss no cell that lies between them.
    pair_until = 0.8 * n / (4.0 * math.pi)
    for k in range(free.shape[0]):
        x0, y0 = (positions[k, 0] - origin_x) / resolution, (positions[k, 1] - origin_y) / resolution
        frame = (x0, y0, headings[k, 0], headings[k, 1])
        for b in range(0, n, 4):
            pairs = min(free[k, b], free[k, b + 1]), min(free[k, b + 2], free[k, b + 3])
            if free[k, b] <= 0.0 and free[k, b + 1] <= 0.0 and free[k, b + 2] <= 0.0 and free[k, b + 3] <= 0.0:
                continue
            if begin[k, b] > 0.0 or begin[k, b + 1] > 0.0 or begin[k, b + 2] > 0.0 or begin[k, b + 3] > 0.0:
                for j in range(b, b + 4):
                    at_first, at_last = begin[k, j] / resolution, free[k, j] / resolution
                    cast(votes, k + 1, frame, table[2 * j + 1], at_first, at_last, np.inf)
                    if k < farther.shape[0]:
                        at_first, at_last = farther[k, j, 0] / resolution, farther[k, j, 1] / resolution
                        cast(votes, k + 1, frame, table[2 * j + 1], at_first, at_last, np.inf)
                continue
            shared = cast(
                votes, k + 1, frame, table[2 * b + 4], 0.0, min(pairs[0], pairs[1]) / resolution, 0.5 * pair_until
            )
            for i in range(2):
                at = b + 2 * i
                until = cast(votes, k + 1, frame, table[2 * at + 2], shared, pairs[i] / resolution, pair_until)
                for j in range(at, at + 2):
                    cast(votes, k + 1, frame, table[2 * j + 1], until, free[k, j] / resolution, np.inf)
    return votes.astype(np.int32)


@kernel
def cast(
    votes: IntArray, number: int, frame: tuple[float, float, float, float], bearing: FloatArray, begin: float,
    reach: float, limit: float,
) -> float:  # fmt: skip
    """Count the cells between ``begin`` and ``reach`` along a ray once for keyframe ``number``, up to ``limit``, all in
    cells; returns where it stopped, at least ``begin``.

    votes: (rows, columns), see ``count_free``. frame: x, y of the camera [cells], cosine and sine of its heading."""
    until = min(reach, limit)
    if until <= begin:
        return begin
    x0, y0, c, s = frame
    rows, columns = votes.shape[0], votes.shape[1]
    dx = int(0.5 * _FIXED * (c * bearing[0] - s * bearing[1]))
    dy = int(0.5 * _FIXED * (s * bearing[0] + c * bearing[1]))
    first, last = int(2.0 * begin), int(2.0 * until)
    x, y = int(_FIXED * x0) + first * dx, int(_FIXED * y0) + first * dy
    # A straight line lies within the grid if both its ends do.
    while first <= last and not within(x, y, rows, columns):
        first, x, y = first + 1, x + dx, y + dy
    while first <= last and not within(x + (last - first) * dx, y + (last - first) * dy, rows, columns):
        last -= 1
    counted = (number << 32) + 1
    for _ in range(first, last + 1):
        row, column = np.uint32(y >> _FIXED_BITS), np.uint32(x >> _FIXED_BITS)
        said = votes[row, column]
        # Always written, to avoid a branch.
        votes[row, column] = counted + (said & 0xFFFFFFFF) if said < counted else said
        x += dx
        y += dy
    return until


@kernel
def within(x: int, y: int, rows: int, columns: int) -> bool:
    """Whether a place in fixed point lies in the grid."""
    return 0 <= x >> _FIXED_BITS < columns and 0 <= y >> _FIXED_BITS < rows
