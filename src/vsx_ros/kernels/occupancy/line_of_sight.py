"""Which cells of a grid can be seen from a set of cells."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def seen_cells(opaque: BoolArray, viewers: IntArray, reach: float, n_rays: int) -> BoolArray:
    """(H, W) bool: cells that a ray from any viewer (V, 2: row, column) meets within ``reach`` cells.

    opaque: (H, W) bool; a ray sees the first opaque cell it meets and ends there.
    """
    rows, columns = opaque.shape
    seen = np.zeros((rows, columns), np.bool_)
    for v in range(viewers.shape[0]):
        for r in range(n_rays):
            angle = 2.0 * math.pi * r / n_rays
            dy, dx = 0.5 * math.sin(angle), 0.5 * math.cos(angle)
            y, x = viewers[v, 0] + 0.5, viewers[v, 1] + 0.5
            for _ in range(int(2.0 * reach)):
                y += dy
                x += dx
                row, column = math.floor(y), math.floor(x)
                if row < 0 or row >= rows or column < 0 or column >= columns:
                    break
                seen[row, column] = True
                if opaque[row, column]:
                    break
    return seen
