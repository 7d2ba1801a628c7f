"""Small loops of every frame that whole-array operations would take many times as long for."""

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel


@kernel
def index_rows(positions: Int32Array, counts: IntArray, table: IntArray) -> IntArray:
    """Index of every row's first corner, one closing entry per level. positions (N, 2) int32 level px, sorted by level
    and row; counts (L,) int64: corners per level; table (L, 4): see ``patches``."""
    out = np.empty(table[:, 1].sum() + table.shape[0], np.int64)
    corner, end, row = 0, 0, 0
    for level in range(table.shape[0]):
        end += counts[level]
        for y in range(table[level, 1] + 1):
            while corner < end and positions[corner, 1] < y:
                corner += 1
            out[row] = corner
            row += 1
    return out


@kernel
def count_hidden(uv: FloatArray, depth: FloatArray, found: BoolArray, cell_px: int, behind: float) -> int:
    """How many of the points at uv (S, 2) px and depth (S,) m are not found (S,) and lie ``behind`` times as far away
    as the nearest found one in the same cell of the image."""
    columns, rows = 1, 1
    for s in range(uv.shape[0]):
        columns, rows = max(columns, int(uv[s, 0]) // cell_px + 1), max(rows, int(uv[s, 1]) // cell_px + 1)
    nearest = np.full((rows, columns), np.inf)
    for s in range(uv.shape[0]):
        row, column = int(uv[s, 1]) // cell_px, int(uv[s, 0]) // cell_px
        if found[s] and depth[s] < nearest[row, column]:
            nearest[row, column] = depth[s]
    count = 0
    for s in range(uv.shape[0]):
        if not found[s] and depth[s] > behind * nearest[int(uv[s, 1]) // cell_px, int(uv[s, 0]) // cell_px]:
            count += 1
    return count
