"""Where a search over short arcs has come out of a narrow place."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.motions import BENDS, MOTIONS, SIGNS, arc_is_free

_FREE_ARCS = 3  # of the six around a pose, each two arcs of the coarse search long


@kernel
def best_exit(
    field: DistanceField, poses: FloatArray, parents: IntArray, motions: NDArray[np.int8], step: float, phi: float,
    arc: float, remaining: FloatArray, near: DistanceField,
) -> int:  # fmt: skip
    """Of the arrivals of ``lattice_search`` the one nearest to start and goal from which longer arcs are free; or -1.

    poses (N, 3), parents (N,), motions (N,) and step [m] of the search in the field ``near``, a part of ``field``;
    remaining: distance to the goal [m] of each cell of ``near``. arc: length of the longer arcs [m].
    The last motion is forward, so that two legs in reverse do not become one."""
    count = poses.shape[0]
    arrived = np.zeros(count)
    best, winner = np.inf, -1
    for k in range(1, count):
        arrived[k] = arrived[parents[k]] + step
        i, j = (
            int((poses[k, 1] - near.origin_y) / near.resolution),
            int((poses[k, 0] - near.origin_x) / near.resolution),
        )
        i, j = min(max(i, 0), remaining.shape[0] - 1), min(max(j, 0), remaining.shape[1] - 1)
        cost = arrived[k] + remaining[i, j]
        if cost >= best or SIGNS[motions[k]] < 0:
            continue
        free = 0
        for m in range(MOTIONS):
            free += arc_is_free(field, poses[k, 0], poses[k, 1], poses[k, 2], BENDS[m] * phi, SIGNS[m] * 2.0 * arc)
        if free >= _FREE_ARCS:
            best, winner = cost, k
    return winner
