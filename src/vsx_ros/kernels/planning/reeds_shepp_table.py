"""Lengths of shortest Reeds-Shepp words, looked up."""

import math

import numpy as np

from vsx_ros.arrays import Float32Array
from vsx_ros.kernels import kernel
from vsx_ros.kernels.planning.reeds_shepp import (
    TABLE_HEADINGS,
    TABLE_PLACES,
    TABLE_STEP,
    reeds_shepp_shortest,
    room_for,
)


@kernel
def reeds_shepp_table() -> Float32Array:
    """(TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1) float32: shortest lengths in radii from the origin.

    x and y in steps of TABLE_STEP radii from 0 on, headings around the circle (the last as the first): a quadrant, the
    others are its mirror images.
    """
    out = np.empty((TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1), np.float32)
    word = room_for(1)
    for i in range(TABLE_PLACES):
        for j in range(TABLE_PLACES):
            for k in range(TABLE_HEADINGS + 1):
                theta = k * 2.0 * math.pi / TABLE_HEADINGS
                out[i, j, k] = reeds_shepp_shortest(i * TABLE_STEP, j * TABLE_STEP, theta, word)
    return out


@kernel
def look_up_length(table: Float32Array, x: float, y: float, theta: float) -> float:
    """About the shortest length in radii to (x, y, theta), x and y in radii; 0 outside the table.

    Interpolated in ``reeds_shepp_table``: a guide for searches, neither a lower bound nor an upper.
    """
    if x < 0.0:
        x, theta = -x, -theta
    if y < 0.0:
        y, theta = -y, -theta
    u, v = x / TABLE_STEP, y / TABLE_STEP
    i, j = int(u), int(v)
    if i >= TABLE_PLACES - 1 or j >= TABLE_PLACES - 1:
        return 0.0
    w = theta / (2.0 * math.pi)
    w = (w - math.floor(w)) * TABLE_HEADINGS
    k = min(int(w), TABLE_HEADINGS - 1)
    u, v, w = u - i, v - j, w - k
    near = (1.0 - v) * table[i, j, k] + v * table[i, j + 1, k]
    far = (1.0 - v) * table[i + 1, j, k] + v * table[i + 1, j + 1, k]
    low = (1.0 - u) * near + u * far
    near = (1.0 - v) * table[i, j, k + 1] + v * table[i, j + 1, k + 1]
    far = (1.0 - v) * table[i + 1, j, k + 1] + v * table[i + 1, j + 1, k + 1]
    high = (1.0 - u) * near + u * far
    length: float = (1.0 - w) * low + w * high
    return length
