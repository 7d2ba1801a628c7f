"""Rays of cameras above the height of obstacles: each is low enough to meet one only on the last stretch of its way.

Stretches of one bearing are joined where they overlap. Where they do not, no ray proves the ground between free."""

import numpy as np

from vsx_ros.arrays import Float32Array, Int32Array
from vsx_ros.kernels import kernel, part


@kernel
def low_begin(distance: float, z: float, camera_z: float, clear_max: float) -> float:
    """Horizontal distance [m] from which a ray to a point of height z [m] is at most clear_max [m] high; 0 for a ray
    that begins there, infinite for one that stays above."""
    if camera_z <= clear_max:
        return 0.0
    return distance * (camera_z - clear_max) / (camera_z - z) if z < clear_max else np.inf


@kernel
def join_stretches(
    stretches: Float32Array, keyframe: Int32Array, bearing: Int32Array, begin: Float32Array, free: Float32Array,
    farther: Float32Array,
) -> None:  # fmt: skip
    """Join stretches (O, 2), from and to [m], each in bin ``bearing`` (O,) of scan ``keyframe`` (O,). One that ends
    before it begins proves nothing. Their order does not matter.

    begin, free (K, B) and farther (K, B, 2) of ``PolarScans``, in place, where they are still 0: the nearest of the
    joined stretches in each bin, and the next. What lies beyond a second gap is left out."""
    proven = np.flatnonzero(stretches[:, 1] > stretches[:, 0])
    for o in proven[np.argsort(stretches[proven, 0])]:
        k, b = keyframe[o], bearing[o]
        low_from, end = stretches[o, 0], stretches[o, 1]
        if free[k, b] == 0.0:
            begin[k, b], free[k, b] = low_from, end
        elif low_from <= free[k, b]:
            free[k, b] = max(free[k, b], end)
        elif farther[k, b, 1] == 0.0:
            farther[k, b, 0], farther[k, b, 1] = low_from, end
        elif low_from <= farther[k, b, 1]:
            farther[k, b, 1] = max(farther[k, b, 1], end)


@part
def add_last(
    low_from: np.float32, end: np.float32, k: int, b: int, begin: Float32Array, free: Float32Array,
    farther: Float32Array,
) -> None:  # fmt: skip
    """Join one more stretch [m] to those of bin b of scan k, which end no farther off; arrays as above, in place. A
    third separate one is left out."""
    if end <= low_from:
        return
    if free[k, b] <= begin[k, b]:
        begin[k, b], free[k, b] = low_from, end
    elif low_from <= free[k, b]:
        begin[k, b], free[k, b] = min(begin[k, b], low_from), max(free[k, b], end)
    elif farther[k, b, 1] <= farther[k, b, 0]:
        farther[k, b, 0], farther[k, b, 1] = low_from, end
    elif low_from <= farther[k, b, 1]:
        farther[k, b, 0], farther[k, b, 1] = min(farther[k, b, 0], low_from), end
