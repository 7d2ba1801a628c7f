"""A tree of motion primitives of bounded change of view, grown until the last segment can be tried (paper 4.4)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.motions import arc_is_free
from vsx_ros.kernels.planning.reeds_shepp import advance
from vsx_ros.kernels.planning.shortcuts import random_unit

BENDS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
_FAVOURABLE = 0.15  # share of the samples drawn where one segment leads to the goal


@kernel
def cone(x: float, y: float, d: float, phi: float) -> tuple[float, float]:
    """(a, b): straight lengths before and after the minimal arc of turn d to (x, y); both >= 0 if reachable."""
    sign = 1.0 if d >= 0.0 else -1.0
    angle = abs(d)
    gx, gy = x - math.sin(angle) / phi, sign * y - (1.0 - math.cos(angle)) / phi
    if math.sin(angle) < 1e-6:
        return -1.0, -1.0
    b = gy / math.sin(angle)
    return gx - b * math.cos(angle), b


@kernel
def _last_leg_is_free(field: DistanceField, pose: FloatArray, goal: FloatArray, phi: float, direction: float) -> bool:
    """Whether straight, arc, straight in one direction joins two poses over free ground."""
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = goal[2] - pose[2]
    turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    a, b = cone(direction * (c * dx + s * dy), c * dy - s * dx, direction * turn, phi)
    if a < 0.0 or b < 0.0:
        return False
    x, y, theta = pose[0], pose[1], pose[2]
    bend = direction * (1.0 if direction * turn > 0.0 else -1.0)
    arc = abs(turn) / phi
    for kappa, length in ((0.0, a), (direction * bend * phi, arc), (0.0, b)):
        if not arc_is_free(field, x, y, theta, kappa, direction * length):
            return False
        x, y, theta = advance(x, y, theta, kappa / phi, direction * length, phi)
    return True


@kernel
def random_pose(field: DistanceField, open_cells: IntArray, state: NDArray[np.uint64], pose: FloatArray) -> None:
    """Fill pose (3,) with a random place in one of the cells, given as flat indices (M,), and a random heading."""
    columns = field.values.shape[1]
    cell = open_cells[int(random_unit(state) * open_cells.shape[0])]
    pose[0] = field.origin_x + (cell % columns + random_unit(state)) * field.resolution
    pose[1] = field.origin_y + (cell // columns + random_unit(state)) * field.resolution
    pose[2] = (2.0 * random_unit(state) - 1.0) * math.pi


@kernel
def favourable_pose(goal: FloatArray, phi: float, state: NDArray[np.uint64], pose: FloatArray) -> None:
    """Fill pose (3,) with a pose from which a random straight, arc and straight lead to the goal."""
    d = (0.5 + 2.1 * random_unit(state)) * (1.0 if random_unit(state) < 0.5 else -1.0)
    direction = 1.0 if random_unit(state) < 0.5 else -1.0
    x, y, theta = advance(goal[0], goal[1], goal[2], 0.0, -direction * random_unit(state), phi)
    x, y, theta = advance(x, y, theta, direction * (1.0 if d > 0.0 else -1.0), -direction * abs(d) / phi, phi)
    pose[0], pose[1], pose[2] = advance(x, y, theta, 0.0, -direction * random_unit(state), phi)


@kernel
def pose_distance(a: FloatArray, b: FloatArray, phi: float, below: float) -> float:
    """Distance [m] of pose a (3,) from b (3,), plus a share of the turn if the distance is less than ``below``."""
    d: float = math.hypot(a[0] - b[0], a[1] - b[1])
    if d >= below:
        return d
    turn: float = abs(a[2] - b[2]) % (2.0 * math.pi)
    return d + 0.4 / phi * min(turn, 2.0 * math.pi - turn)


@kernel
def _nearest(poses: FloatArray, pose: FloatArray, phi: float) -> int:
    best, near = np.inf, 0
    for k in range(poses.shape[0]):
        d = pose_distance(poses[k], pose, phi, best)
        if d < best:
            best, near = d, k
    return near


class Grown(NamedTuple):
    """A tree of N states at most: poses (N, 3), parents (N,); bends (N,) and signs (N,) of the primitive to each, runs
    (N,) in reverse so far [m]."""

    poses: FloatArray
    parents: IntArray
    bends: FloatArray
    signs: FloatArray
    runs: FloatArray


@kernel
def grow(
    field: DistanceField, open_cells: IntArray, goal: FloatArray, phi: float, step: float, max_reverse: float,
    tree: Grown, size: int, rng: NDArray[np.uint64],
) -> tuple[int, int]:  # fmt: skip
    """Grow a tree, filled up to ``size``, until a new state's last leg to the goal (3,) looks free, or it is full.

    rng (1,) uint64. Returns (size, state to try or -1)."""
    poses, parents, bends, signs, runs = tree
    sample = np.empty(3)
    for _ in range(20 * poses.shape[0]):
        if size >= poses.shape[0]:
            return size, -1
        if random_unit(rng) < _FAVOURABLE:
            favourable_pose(goal, phi, rng, sample)
        else:
            random_pose(field, open_cells, rng, sample)
        near = _nearest(poses[:size], sample, phi)
        best, bend, sign = np.inf, 0.0, 0.0
        for m in range(2 * BENDS.shape[0]):
            kappa, way = BENDS[m // 2], 1.0 if m % 2 == 0 else -1.0
            if way < 0.0 and runs[near] + step > max_reverse:
                continue
            x, y, theta = advance(poses[near, 0], poses[near, 1], poses[near, 2], kappa, way * step, phi)
            turn = abs(theta - sample[2]) % (2.0 * math.pi)
            d = math.hypot(x - sample[0], y - sample[1]) + 0.4 / phi * min(turn, 2.0 * math.pi - turn)
            if d < best and arc_is_free(field, poses[near, 0], poses[near, 1], poses[near, 2], kappa * phi, way * step):
                best, bend, sign = d, kappa, way
        if sign == 0.0:
            continue
        x, y, theta = advance(poses[near, 0], poses[near, 1], poses[near, 2], bend, sign * step, phi)
        poses[size, 0], poses[size, 1], poses[size, 2] = x, y, theta
        parents[size], bends[size], signs[size] = near, bend, sign
        runs[size] = runs[near] + step if sign < 0.0 else 0.0
        size += 1
        for direction in (1.0, -1.0):
            if _last_leg_is_free(field, poses[size - 1], goal, phi, direction):
                return size, size - 1
    return size, -1
