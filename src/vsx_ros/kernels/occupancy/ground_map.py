"""Polar scans from point observations and surfaces, for the ground map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray, Points2, Points3
from vsx_ros.kernels import kernel
from vsx_ros.kernels.occupancy.low_rays import add_last, join_stretches, low_begin


class PolarScans(NamedTuple):
    """Scans of K keyframes and what they hit.

    positions: (K, 3) camera centres, world [m]. headings: (K, 2) cosine and sine of the headings of the optical axes.
    Bearings count from these, counter-clockwise, in B equal bins around the circle.
    free: (K, B), passable up to this distance [m], 0 where unknown. begin: (K, B), and from this distance on [m]: rays
    of a high camera come down to the height of obstacles only there.
    nearest: (K, B), limit of a ray by the first obstacle point [m], infinite where there is none.
    hit: (O,), horizontal distance [m] of the obstacle in each observation, 0 if it shows no obstacle; over: the same
    for points higher than an obstacle, which may stand on one.
    farther: (K, B, 2), from where to where [m] a bearing is passable again, 0 where it is not: other rays of a high
    camera come down there, and none between. No rows if no camera is high."""

    positions: Points3
    headings: Points2
    free: Float32Array
    begin: Float32Array
    nearest: Float32Array
    hit: Float32Array
    over: Float32Array
    farther: Float32Array = np.zeros((0, 0, 2), np.float32)


class Surfaces(NamedTuple):
    """points (N, 3): spots of surface, world [m], no further apart than a cell of the map where the surface has no gap.
    keyframe (N,): index of the keyframe that sees each. sigma_m (N,): uncertainty of its distance from there [m].
    shown (S,): rows of spots at the foot of a wall; witness (S,): index of another keyframe that sees each there."""

    points: Points3
    keyframe: IntArray
    sigma_m: FloatArray
    shown: IntArray = np.zeros(0, np.int64)
    witness: IntArray = np.zeros(0, np.int64)

    @staticmethod
    def none() -> Surfaces:
        """No surface."""
        return Surfaces(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0))


@kernel
def point_parallax(
    positions: FloatArray, points: FloatArray, obs_keyframe: Int32Array, obs_point: Int32Array
) -> FloatArray:
    """(M,) widest angle [rad] between the first ray to each point and any other; 0 for points seen once.

    positions: (K, 3) camera centres. points: (M, 3). obs_keyframe, obs_point: (O,) indices of each observation."""
    first = np.full(points.shape[0], -1, np.int64)
    cosine = np.ones(points.shape[0])
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
            cosine[p] = min(cosine[p], max(-1.0, dot / math.sqrt(aa * bb)))
    return np.arccos(cosine)


@kernel
def polar_scans(
    positions: FloatArray, headings: FloatArray, points: FloatArray, parallax: FloatArray, obs_keyframe: Int32Array,
    obs_point: Int32Array, n_bearings: int, heights: tuple[float, float, float, float, float],
    ranges: tuple[float, float, float, float, float],
) -> PolarScans:  # fmt: skip
    """Scans of the floor around each keyframe, from its observations.

    heights: obstacle_min, obstacle_max, clear_max, top of what stands on an obstacle [m], floor threshold growth [m per
    m]. ranges: max range [m], angular noise of a pixel [rad], largest depth error of a hit [m], half a cell [m], number
    of depth errors by which a ray ends before its point."""
    obstacle_min, obstacle_max, clear_max, top, growth = heights
    max_range, noise, max_error, half_width, caution = ranges
    n, bins_per_rad = n_bearings, n_bearings / (2.0 * math.pi)
    free = np.zeros((positions.shape[0], n), np.float32)
    begin = np.zeros_like(free)
    nearest = np.full((positions.shape[0], n), np.inf, np.float32)
    hit, over = np.zeros(obs_point.shape[0], np.float32), np.zeros(obs_point.shape[0], np.float32)
    any_high = np.any(positions[:, 2] > clear_max)
    farther = np.zeros((positions.shape[0] if any_high else 0, n, 2), np.float32)
    stretches = np.zeros((obs_point.shape[0] if any_high else 0, 2), np.float32)
    bins = np.zeros(stretches.shape[0], np.int32)
    for o in range(obs_point.shape[0]):
        k, p = obs_keyframe[o], obs_point[o]
        dx, dy = points[p, 0] - positions[k, 0], points[p, 1] - positions[k, 1]
        z, camera_z = points[p, 2], positions[k, 2]
        distance = math.sqrt(dx * dx + dy * dy)
        floor = obstacle_min + growth * distance
        if parallax[p] <= 0.0 or distance < 1e-6 or z < -floor:
            continue
        error = noise * distance / parallax[p]
        bearing = bearing_bin(headings[k, 0], headings[k, 1], dx, dy, n)
        proven = distance - caution * error - 2.0 * half_width
        if floor < z <= obstacle_max and error <= max_error:
            shorten(nearest, k, bearing, min(n // 2, 1 + int(half_width / distance * bins_per_rad)), proven)
            if distance <= max_range:
                hit[o] = distance
        elif obstacle_max < z <= top and error <= max_error and distance <= max_range:
            over[o] = distance
        if z > clear_max:
            low_until = distance * max(0.0, clear_max - camera_z) / (z - camera_z) if z > camera_z else 0.0
            proven = min(proven, low_until)
        if camera_z <= clear_max:
            free[k, bearing] = max(free[k, bearing], min(proven, max_range))
        else:
            bins[o], stretches[o, 0] = bearing, low_begin(distance, z, camera_z, clear_max)
            stretches[o, 1] = min(proven, max_range)
    join_stretches(stretches, obs_keyframe, bins, begin, free, farther)
    free = np.maximum(np.minimum(free, nearest), np.float32(0.0))
    farther[:, :, 1] = np.minimum(farther[:, :, 1], nearest[: farther.shape[0]])
    return PolarScans(
        positions=positions, headings=headings, free=free, begin=begin, nearest=nearest, hit=hit, over=over,
        farther=farther,
    )  # fmt: skip


@kernel
def meet_surfaces(
    scans: PolarScans, surfaces: Surfaces, touched: BoolArray, shape: tuple[float, float, float],
    reaches: tuple[float, float, float],
) -> None:  # fmt: skip
    """End scans, in place, at the touched (N,) spots of surface that their own keyframe sees.

    No ray goes farther; a ray to the foot of a surface is extended to it, unless something is nearer.

    shape: half a spot's width [m]; number of sigmas, and extra distance [m], by which a ray ends before it. reaches:
    height up to which a spot is a foot, longest ray, height up to which a ray proves the floor free, as for the scans
    [m]."""
    free, farther, longest = scans.free, scans.farther, np.float32(reaches[1])
    until, feet = scans.nearest.copy(), np.full(free.shape, np.inf, np.float32)
    for i in range(surfaces.points.shape[0]):
        if touched[i]:
            _end_at(scans, surfaces, i, surfaces.keyframe[i], shape, reaches, until, feet)
    for s in range(surfaces.shown.shape[0]):
        if touched[surfaces.shown[s]]:
            _end_at(scans, surfaces, surfaces.shown[s], surfaces.witness[s], shape, reaches, until, feet)
    farther[:, :, 1] = np.minimum(farther[:, :, 1], until[: farther.shape[0]])
    for k in range(free.shape[0]):
        for b in range(free.shape[1]):
            free[k, b] = min(free[k, b], max(until[k, b], np.float32(0.0)))
            if feet[k, b] < np.inf:
                add_last(feet[k, b], min(until[k, b], longest), k, b, scans.begin, free, farther)


@kernel
def _end_at(
    scans: PolarScans, surfaces: Surfaces, i: int, k: int, shape: tuple[float, float, float],
    reaches: tuple[float, float, float], until: Float32Array, feet: Float32Array,
) -> None:  # fmt: skip
    """End the rays of scan k at spot i: until (K, B), in place; feet (K, B): from where a ray to a foot is low [m],
    infinite without one."""
    half_width, caution, short = shape
    n = until.shape[1]
    dx, dy = surfaces.points[i, 0] - scans.positions[k, 0], surfaces.points[i, 1] - scans.positions[k, 1]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance <= half_width:
        return
    bearing = bearing_bin(scans.headings[k, 0], scans.headings[k, 1], dx, dy, n)
    reach = min(n // 2, int(half_width / distance * n / (2.0 * math.pi)))
    shorten(until, k, bearing, reach, max(0.0, distance - caution * surfaces.sigma_m[i] - short))
    if surfaces.points[i, 2] <= reaches[0]:
        low_from = low_begin(distance, surfaces.points[i, 2], scans.positions[k, 2], reaches[2])
        for b in range(bearing - reach, bearing + reach + 1):
            feet[k, b % n] = min(feet[k, b % n], low_from)


@kernel
def shorten(scans: Float32Array, k: int, bearing: int, reach: int, until: float) -> None:
    """Limit the rays of scan k of (K, B) within ``reach`` bins of a bearing to ``until`` [m]."""
    n = scans.shape[1]
    for b in range(bearing - reach, bearing + reach + 1):
        wrapped = b + n if b < 0 else (b - n if b >= n else b)
        scans[k, wrapped] = min(scans[k, wrapped], until)


@kernel
def bearing_bin(c: float, s: float, dx: float, dy: float, n_bearings: int) -> int:
    """The bin of a direction, counted from a heading of cosine c and sine s; bin 0 begins there.

    The arctangent is Abramowitz and Stegun 4.4.47, precise to 1e-5 rad in a third of the library's time."""
    ahead, left = c * dx + s * dy, c * dy - s * dx
    wide, narrow = max(abs(ahead), abs(left)), min(abs(ahead), abs(left))
    t = narrow / wide if wide > 0.0 else 0.0
    q = t * t
    turn = t * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351)))) / (2.0 * math.pi)
    if abs(left) > abs(ahead):
        turn = 0.25 - turn
    if ahead < 0.0:
        turn = 0.5 - turn
    if left < 0.0:
        turn = 1.0 - turn
    return min(int(turn * n_bearings), n_bearings - 1)


@kernel
def bridge_gaps(free: Float32Array, begin: Float32Array, max_gap: int, max_width: float) -> None:
    """Fill the empty bins of free (K, B) between two filled ones with the smaller of the two, in place, and those of
    begin (K, B) with the greater: with what both prove.

    Only where at most max_gap bins are empty, and only as far out as they are at most max_width [m] wide."""
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
                        free[k, (b + i) % n] = reach
                        begin[k, (b + i) % n] = max(begin[k, b], begin[k, (b + gap + 1) % n])
                    break
