"""What images leave open: without odometry nothing says how large a map is."""

import numpy as np

from vsx_ros.arrays import Points3

ROUNDS = 4  # of reweighting: what few keyframes do differently is settled after two


def size_kept(before: Points3, after: Points3, held: int) -> float:
    """By how much keyframes must grow about the one that is held (index) to be as large as before: least squares of
    their positions (K, 3), those far off weighing less (Cauchy)."""
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
