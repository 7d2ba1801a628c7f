"""What the scans of all keyframes say together about each cell of the ground map."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel


@kernel
def count_hits(
    points: FloatArray,
    obs_point: IntArray,
    hit: Float32Array,
    enough: int,
    rows: int,
    columns: int,
    resolution: float,
    origin_x: float,
    origin_y: float,
) -> tuple[Int32Array, Int32Array]:
    """(rows, columns) int32 twice: observations of obstacle points in each cell, and points with enough of them."""
    votes = np.zeros((rows, columns), np.int32)
    members = np.zeros((rows, columns), np.int32)
    counted = np.zeros(points.shape[0], np.int32)
    for o in range(obs_point.shape[0]):
        if hit[o] <= 0.0:
            continue
        p = obs_point[o]
        column = math.floor((points[p, 0] - origin_x) / resolution)
        row = math.floor((points[p, 1] - origin_y) / resolution)
        if 0 <= row < rows and 0 <= column < columns:
            votes[row, column] += 1
            counted[p] += 1
            if counted[p] == enough:
                members[row, column] += 1
    return votes, members


@kernel
def count_spots(
    spots: FloatArray, touched: BoolArray, rows: int, columns: int, resolution: float, origin_x: float, origin_y: float
) -> Int32Array:
    """(rows, columns) int32: how many of the touched spots (N, 3) lie above each cell."""
    votes = np.zeros((rows, columns), np.int32)
    for i in range(spots.shape[0]):
        column = math.floor((spots[i, 0] - origin_x) / resolution)
        row = math.floor((spots[i, 1] - origin_y) / resolution)
        if touched[i] and 0 <= row < rows and 0 <= column < columns:
            votes[row, column] += 1
    return votes


@kernel
def believed_points(
    votes: Int32Array,
    members: Int32Array,
    over_votes: Int32Array,
    over_members: Int32Array,
    free_votes: Int32Array,
    least: int,
    sure: int,
    overruled_by: float,
    few_overruled_by: float,
) -> BoolArray:
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
def believed_spots(votes: Int32Array, free_votes: Int32Array, least: int, overruled_by: float) -> BoolArray:
    """(rows, columns) whether a cell with votes (rows, columns) of surface is solid, judged with its eight neighbours.

    They hold ``least`` votes, and not more than ``overruled_by`` times as many free_votes a cell.
    """
    rows, columns = votes.shape
    believed = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if votes[row, column] > 0:
                near = around(votes, row, column)
                free = around(free_votes, row, column) / 9.0
                believed[row, column] = near >= least and free <= overruled_by * near
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
def cover_discs(
    poses: FloatArray, radius: float, rows: int, columns: int, resolution: float, origin_x: float, origin_y: float
) -> BoolArray:
    """(rows, columns) whether the middle of a cell lies within radius [m] of one of the poses (N, 2)."""
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
