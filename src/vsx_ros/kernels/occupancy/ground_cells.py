"""What the scans of all keyframes say together about each cell of the ground map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray, Points2
from vsx_ros.kernels import kernel

_MARGIN_M = 0.5


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
        return Lattice(rows, columns, resolution, float(low[0] * resolution), float(low[1] * resolution))

    def centres(self) -> tuple[FloatArray, FloatArray]:
        """x of each column (1, columns) and y of each row (rows, 1) [m]."""
        x = self.origin_x + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.resolution
        y = self.origin_y + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.resolution
        return x[None, :], y[:, None]


@kernel
def _cell(lattice: Lattice, x: float, y: float) -> tuple[int, int]:
    """Row and column of a place [m], row -1 outside."""
    column = math.floor((x - lattice.origin_x) / lattice.resolution)
    row = math.floor((y - lattice.origin_y) / lattice.resolution)
    return row if 0 <= row < lattice.rows and 0 <= column < lattice.columns else -1, column


@kernel
def count_hits(
    points: FloatArray, obs_point: IntArray, hit: Float32Array, enough: int, lattice: Lattice
) -> tuple[Int32Array, Int32Array]:
    """(rows, columns) int32 twice: observations of obstacle points in each cell, and points with enough of them."""
    votes = np.zeros((lattice.rows, lattice.columns), np.int32)
    members = np.zeros_like(votes)
    counted = np.zeros(points.shape[0], np.int32)
    for o in range(obs_point.shape[0]):
        if hit[o] <= 0.0:
            continue
        p = obs_point[o]
        row, column = _cell(lattice, points[p, 0], points[p, 1])
        if row >= 0:
            votes[row, column] += 1
            counted[p] += 1
            if counted[p] == enough:
                members[row, column] += 1
    return votes, members


@kernel
def believed_points(
    votes: Int32Array, members: Int32Array, over_votes: Int32Array, over_members: Int32Array, free_votes: Int32Array,
    least: int, sure: int, overruled_by: float, few_overruled_by: float,
) -> BoolArray:  # fmt: skip
    """(rows, columns) whether a cell with votes (rows, columns) is an obstacle, judged with its eight neighbours.

    They hold ``least`` of the members, and free_votes not more times the votes than may overrule many, or fewer than
    ``sure``, members; one free vote of a cell weighs as much as nine of all. What is over them counts with them: what
    stands on the floor goes on upwards, a wrong match before the floor does not.
    """
    rows, columns = votes.shape
    believed = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if votes[row, column] == 0:
                continue
            points = around(members, row, column)
            if points > 0:
                points += around(over_members, row, column)
            limit = overruled_by if points >= sure else few_overruled_by
            free = around(free_votes, row, column) / 9.0
            seen = around(votes, row, column) + around(over_votes, row, column)
            believed[row, column] = points >= least and free <= limit * seen
    return believed


@kernel
def around(counts: Int32Array, row: int, column: int) -> int:
    """The sum over a cell and its neighbours."""
    total = 0
    for r in range(max(0, row - 1), min(counts.shape[0], row + 2)):
        for c in range(max(0, column - 1), min(counts.shape[1], column + 2)):
            total += counts[r, c]
    return total


@kernel
def cover_discs(poses: FloatArray, radius: float, lattice: Lattice) -> BoolArray:
    """(rows, columns) whether the middle of a cell lies within radius [m] of one of the poses (N, 2)."""
    rows, columns, resolution, origin_x, origin_y = lattice
    covered = np.zeros((rows, columns), np.bool_)
    reach = int(radius / resolution) + 2
    for i in range(poses.shape[0]):
        x, y = poses[i, 0] - origin_x, poses[i, 1] - origin_y
        row, column = math.floor(y / resolution), math.floor(x / resolution)
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            dy = (r + 0.5) * resolution - y
            for c in range(max(0, column - reach), min(columns, column + reach + 1)):
                dx = (c + 0.5) * resolution - x
                if dx * dx + dy * dy <= radius * radius:
                    covered[r, c] = True
    return covered
