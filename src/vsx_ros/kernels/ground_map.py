"""Loops of the ground map: polar scans out of point observations, and votes of scans for cells."""

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel


@kernel
def point_parallax(positions: Any, points: Any, obs_keyframe: Any, obs_point: Any) -> Any:
    """(M,) widest angle [rad] between the first ray to each point and any other; 0 for points seen once.

    positions: (K, 3) camera centres. points: (M, 3). obs_keyframe, obs_point: (O,) indices of each observation.
    """
    first = np.full(points.shape[0], -1, np.int64)
    parallax = np.zeros(points.shape[0])
    for o in range(obs_point.shape[0]):
        p, k = obs_point[o], obs_keyframe[o]
        if first[p] < 0:
            first[p] = k
            continue
        dot = aa = bb = 0.0
        for axis in range(3):
            a = points[p, axis] - positions[first[p], axis]
            b = points[p, axis] - positions[k, axis]
            dot += a * b
            aa += a * a
            bb += b * b
        if aa > 0.0 and bb > 0.0:
            parallax[p] = max(parallax[p], math.acos(min(1.0, max(-1.0, dot / math.sqrt(aa * bb)))))
    return parallax


@kernel
def polar_scans(
    positions: Any,
    yaws: Any,
    points: Any,
    parallax: Any,
    obs_keyframe: Any,
    obs_point: Any,
    n_bearings: int,
    heights: tuple[float, float, float, float],
    ranges: tuple[float, float, float, float, float],
) -> Any:
    """What each keyframe's observations say about the floor around it.

    yaws: (K,) [rad], bearings count from them, counter-clockwise, in n_bearings equal bins around the circle.
    heights: obstacle_min, obstacle_max, clear_max [m], floor threshold growth [m per m].
    ranges: max range [m], angular noise of a pixel [rad], largest depth error of a hit [m],
    half a cell [m], how many depth errors short of its point a ray ends.
    Returns free (K, n_bearings): distance [m] up to which the floor is passable, 0 where unknown; and
    hit (O,): horizontal distance [m] of the obstacle seen by each observation, 0 where it is none.
    """
    obstacle_min, obstacle_max, clear_max, growth = heights
    max_range, noise, max_error, half_width, caution = ranges
    free = np.zeros((positions.shape[0], n_bearings))
    nearest = np.full((positions.shape[0], n_bearings), np.inf)
    hit = np.zeros(obs_point.shape[0])
    for o in range(obs_point.shape[0]):
        k, p = obs_keyframe[o], obs_point[o]
        dx, dy = points[p, 0] - positions[k, 0], points[p, 1] - positions[k, 1]
        z, camera_z = points[p, 2], positions[k, 2]
        distance = math.sqrt(dx * dx + dy * dy)
        floor = obstacle_min + growth * distance
        if parallax[p] <= 0.0 or distance < 1e-6 or z < -floor:
            continue
        error = noise * distance / parallax[p]
        bearing = bearing_bin(math.atan2(dy, dx) - yaws[k], n_bearings)
        proven = distance - caution * error - 2.0 * half_width
        if floor < z <= obstacle_max and error <= max_error:
            reach = 1 + int(half_width / distance * n_bearings / (2.0 * math.pi))
            for b in range(bearing - reach, bearing + reach + 1):
                nearest[k, b % n_bearings] = min(nearest[k, b % n_bearings], proven)
            if distance <= max_range:
                hit[o] = distance
        if z > clear_max:
            low_until = distance * max(0.0, clear_max - camera_z) / (z - camera_z) if z > camera_z else 0.0
            proven = min(proven, low_until)
        free[k, bearing] = max(free[k, bearing], min(proven, max_range))
    return np.maximum(np.minimum(free, nearest), 0.0), hit


@kernel
def block_scans(positions: Any, yaws: Any, free: Any, spots: Any, keyframe: Any, sigma: Any, shape: Any) -> None:
    """Shorten scans free (K, B) in place where the keyframe of a spot of surface (N, 3) sees it.

    sigma: (N,) uncertainty of its distance [m]. shape: half its width [m], how many sigmas and, besides, how far [m]
    short of it a ray ends.
    """
    half_width, caution, short = shape[0], shape[1], shape[2]
    n = free.shape[1]
    for i in range(spots.shape[0]):
        k = keyframe[i]
        dx, dy = spots[i, 0] - positions[k, 0], spots[i, 1] - positions[k, 1]
        distance = math.sqrt(dx * dx + dy * dy)
        if distance <= half_width:
            continue
        until = max(0.0, distance - caution * sigma[i] - short)
        bearing = bearing_bin(math.atan2(dy, dx) - yaws[k], n)
        reach = int(half_width / distance * n / (2.0 * math.pi))
        for b in range(bearing - reach, bearing + reach + 1):
            free[k, b % n] = min(free[k, b % n], until)


@kernel
def bearing_bin(angle: float, n_bearings: int) -> int:
    """The bin of an angle [rad]; bin 0 begins at angle 0."""
    turn = angle / (2.0 * math.pi)
    return int((turn - math.floor(turn)) * n_bearings) % n_bearings


@kernel
def bridge_gaps(free: Any, max_gap: int, max_width: float) -> Any:
    """Copy of free (K, B) where the empty bins between two filled ones take the smaller of the two.

    Only where at most max_gap bins are empty, and only as far out as they are at most max_width [m] wide.
    """
    bridged = free.copy()
    n = free.shape[1]
    for k in range(free.shape[0]):
        for b in range(n):
            if free[k, b] <= 0.0 or free[k, (b + 1) % n] > 0.0:
                continue
            for gap in range(1, max_gap + 1):
                far = free[k, (b + gap + 1) % n]
                if far > 0.0:
                    reach = min(min(free[k, b], far), max_width / ((gap + 1) * 2.0 * math.pi / n))
                    for i in range(1, gap + 1):
                        bridged[k, (b + i) % n] = reach
                    break
    return bridged


@kernel
def count_free(
    positions: Any,
    yaws: Any,
    free: Any,
    rows: int,
    columns: int,
    resolution: float,
    origin_x: float,
    origin_y: float,
) -> Any:
    """(rows, columns) int32: how many keyframes' scans pass through each cell."""
    votes = np.zeros((rows, columns), np.int32)
    seen_by = np.full((rows, columns), -1, np.int32)
    n = free.shape[1]
    step = 0.5 * resolution
    for k in range(free.shape[0]):
        x0 = (positions[k, 0] - origin_x) / resolution
        y0 = (positions[k, 1] - origin_y) / resolution
        for b in range(n):
            if free[k, b] <= 0.0:
                continue
            angle = yaws[k] + (b + 0.5) * 2.0 * math.pi / n
            dx, dy = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
            for i in range(int(free[k, b] / step) + 1):
                column, row = math.floor(x0 + i * dx), math.floor(y0 + i * dy)
                if 0 <= row < rows and 0 <= column < columns and seen_by[row, column] != k:
                    seen_by[row, column] = k
                    votes[row, column] += 1
    return votes


@kernel
def count_hits(
    points: Any,
    obs_point: Any,
    hit: Any,
    rows: int,
    columns: int,
    resolution: float,
    origin_x: float,
    origin_y: float,
) -> Any:
    """(rows, columns) int32 twice: observations of obstacle points in each cell, and the points themselves."""
    votes = np.zeros((rows, columns), np.int32)
    members = np.zeros((rows, columns), np.int32)
    counted = np.zeros(points.shape[0], np.bool_)
    for o in range(obs_point.shape[0]):
        if hit[o] <= 0.0:
            continue
        p = obs_point[o]
        column = math.floor((points[p, 0] - origin_x) / resolution)
        row = math.floor((points[p, 1] - origin_y) / resolution)
        if 0 <= row < rows and 0 <= column < columns:
            votes[row, column] += 1
            if not counted[p]:
                counted[p] = True
                members[row, column] += 1
    return votes, members


@kernel
def count_spots(spots: Any, rows: int, columns: int, resolution: float, origin_x: float, origin_y: float) -> Any:
    """(rows, columns) int32: how many of the spots (N, 3) lie above each cell."""
    votes = np.zeros((rows, columns), np.int32)
    for i in range(spots.shape[0]):
        column = math.floor((spots[i, 0] - origin_x) / resolution)
        row = math.floor((spots[i, 1] - origin_y) / resolution)
        if 0 <= row < rows and 0 <= column < columns:
            votes[row, column] += 1
    return votes


@kernel
def cover_discs(
    poses: Any, radius: float, rows: int, columns: int, resolution: float, origin_x: float, origin_y: float
) -> Any:
    """(rows, columns) whether the middle of a cell lies within radius [m] of one of the poses (N, 2)."""
    covered = np.zeros((rows, columns), np.bool_)
    reach = int(radius / resolution) + 2
    for i in range(poses.shape[0]):
        x, y = poses[i, 0] - origin_x, poses[i, 1] - origin_y
        row, column = math.floor(y / resolution), math.floor(x / resolution)
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            dy = (r + 0.5) * resolution - y
            for c in range(max(0, column - reach), min(columns, column + reach + 1)):
                dx = (c + 0.5) * resolution - x
                if dx * dx + dy * dy <= radius * radius:
                    covered[r, c] = True
    return covered
