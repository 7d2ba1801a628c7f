"""Keeps the size of a map, which images alone do not determine."""

import numpy as np

from vsx_ros.arrays import Points3

ROUNDS = 4  # of reweighting; with few outliers it converges after two


def size_kept(before: Points3, after: Points3, held: int) -> float:
    """Scale factor about the fixed keyframe ``held`` (index) that restores the former size: least squares on the
    keyframes' positions (K, 3), with Cauchy weights."""
    p, q = before - before[held], after - after[held]
    along, square = np.sum(p * q, axis=1), np.sum(q * q, axis=1)
    weight, factor = np.ones(len(p)), 1.0
    for _ in range(ROUNDS):
        if weight @ square < 1e-12:
            return 1.0
        factor = float(weight @ along / (weight @ square))
        off = np.linalg.norm(factor * q - p, axis=1)
        weight = 1.0 / (1.0 + (off / (2.0 * np.median(off) + 1e-12)) ** 2)
    return factor if factor > 0.0 else 1.0
