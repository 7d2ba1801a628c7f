"""Basins of a height field, by flooding from its peaks downwards: the watershed transform with merging of shallow
basins (L. Vincent and P. Soille, "Watersheds in digital spaces", IEEE PAMI 13, 1991; L. Najman and M. Schmitt,
"Geodesic saliency of watershed contours", IEEE PAMI 18, 1996)."""

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def _root(parent: IntArray, basin: int) -> int:
    while parent[basin] != basin:
        parent[basin] = parent[parent[basin]]
        basin = parent[basin]
    return basin


@kernel
def flood_basins(heights: FloatArray, order: IntArray, narrow_ratio: float) -> IntArray:
    """(H, W) label of the basin of each cell, from 1; 0 where the height is not positive.

    order: flat indices of the cells of positive height, highest first. Two basins that meet at a saddle stay apart when
    the saddle is lower than ``narrow_ratio`` times the lower of their peaks; else they become one."""
    rows, columns = heights.shape
    labels = np.zeros((rows, columns), np.int64)
    parent = np.zeros(order.shape[0] + 1, np.int64)
    peaks = np.zeros(order.shape[0] + 1)
    count = 0
    for k in range(order.shape[0]):
        i, j = order[k] // columns, order[k] % columns
        saddle = heights[i, j]
        # The basin of the highest labelled neighbour takes the cell.
        best, highest = 0, -1.0
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns or labels[a, b] == 0:
                    continue
                if heights[a, b] > highest:
                    best, highest = _root(parent, labels[a, b]), heights[a, b]
        if best == 0:
            count += 1
            parent[count] = count
            peaks[count] = saddle
            labels[i, j] = count
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns or labels[a, b] == 0:
                    continue
                other = _root(parent, labels[a, b])
                if other == best:
                    continue
                if saddle >= narrow_ratio * min(peaks[best], peaks[other]):
                    keep, drop = (best, other) if peaks[best] >= peaks[other] else (other, best)
                    parent[drop] = keep
                    best = keep
        labels[i, j] = best
    for i in range(rows):
        for j in range(columns):
            if labels[i, j]:
                labels[i, j] = _root(parent, labels[i, j])
    return labels
