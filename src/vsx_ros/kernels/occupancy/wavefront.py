"""Shortest 8-connected ways through open cells."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.kernels import kernel


@kernel
def wavefront(open_cells: BoolArray, row: int, column: int) -> FloatArray:
    """(H, W) length [cells] of the shortest 8-connected way from a cell through open cells; inf where there is none.

    open_cells (H, W) bool. A diagonal step needs both cells beside it open, except from the start. Exact.
    """
    rows, columns = open_cells.shape
    size = rows * columns
    distance = np.full((rows, columns), np.inf)
    queued = np.zeros((rows, columns), np.bool_)
    ring = np.empty(size + 1, np.int64)
    head, tail = 0, 1
    ring[0] = row * columns + column
    distance[row, column] = 0.0
    queued[row, column] = True
    diagonal = math.sqrt(2.0)
    while head != tail:
        i, j = ring[head] // columns, ring[head] % columns
        head = head + 1 if head < size else 0
        queued[i, j] = False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= rows or b >= columns or not open_cells[a, b]:
                    continue
                corner = di != 0 and dj != 0
                if corner and not (open_cells[i, b] and open_cells[a, j]) and not (i == row and j == column):
                    continue
                d = distance[i, j] + (diagonal if corner else 1.0)
                if d < distance[a, b] - 1e-9:
                    distance[a, b] = d
                    if not queued[a, b]:
                        queued[a, b] = True
                        ring[tail] = a * columns + b
                        tail = tail + 1 if tail < size else 0
    return distance
