"""How well a map shows the obstacles that the robot had before its camera (paper, Figure 5)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.evaluation.coverage import TOLERANCE_M, metres_to, share, values_at
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

MIN_RANGE_M, MAX_RANGE_M = 0.5, 3.5
MIN_GAP_M, MAX_GAP_M = 0.4, 0.8
_HALF_VIEW_RAD = 0.45
_MIN_VIEWS = 3
_RAYS = 120


@dataclass(frozen=True)
class ObstacleQuality:
    """Of a map against the truth, at 10 cm; shares, None where there is nothing to divide by.

    precision: of occupied cells near a true obstacle. recall: of seen faces near an occupied cell. f1: of both.
    surface_free: seen faces whose cell is called free. free_inside: free cells deeper than 10 cm inside an obstacle.
    phantom_m2: area of occupied cells over 10 cm from any obstacle. gaps_free: known cells in gaps 0.4 to 0.8 m wide,
    over 10 cm from their sides, that are not called occupied.
    """

    precision: float | None
    recall: float | None
    f1: float | None
    surface_free: float | None
    free_inside: float | None
    phantom_m2: float
    gaps_free: float | None


def seen_faces(truth: OccupancyGrid, T_world_cams: Sequence[SE3]) -> BoolArray:
    """(H, W) cells of obstacle surface that at least three cameras see within 3.5 m, well inside their pictures."""
    counts = np.zeros(truth.shape, np.int64)
    blocked = truth.data != FREE
    for T in T_world_cams:
        heading = math.atan2(float(T.rotation[1, 2]), float(T.rotation[0, 2]))
        hits = _first_hits(blocked, truth, T.translation[:2], heading)
        counts[hits[:, 0], hits[:, 1]] += 1
    faces: BoolArray = (counts >= _MIN_VIEWS) & (truth.data == OCCUPIED)
    return faces


def _first_hits(blocked: BoolArray, truth: OccupancyGrid, eye: FloatArray, heading: float) -> IntArray:
    """(N, 2) the cells where rays over the field of view end, each once."""
    angles = heading + np.linspace(-_HALF_VIEW_RAD, _HALF_VIEW_RAD, _RAYS)
    steps = np.arange(0.0, MAX_RANGE_M, 0.4 * truth.resolution)
    places = eye + steps[None, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None, :]
    cells = truth.cells(places.reshape(-1, 2))
    inside = truth.contains(cells)
    solid = np.zeros(len(cells), bool)
    solid[inside] = blocked[cells[inside, 0], cells[inside, 1]]
    stops = solid.reshape(len(angles), len(steps))
    first = stops.argmax(axis=1)
    good = stops.any(axis=1) & (steps[first] > MIN_RANGE_M)
    return np.unique(cells.reshape(len(angles), len(steps), 2)[np.flatnonzero(good), first[good]], axis=0)


def obstacle_quality(grid: OccupancyGrid, truth: OccupancyGrid, faces: BoolArray, T_truth_map: SE2) -> ObstacleQuality:
    """Judge a map. faces: (H, W) of ``seen_faces``. T_truth_map: where the map's origin truly lies."""
    values = on_truth(grid, truth, T_truth_map)
    to_obstacle, to_free = metres_to(truth.data == OCCUPIED, truth), metres_to(truth.data == FREE, truth)
    occupied, free = values == OCCUPIED, values == FREE
    wrong = occupied & (to_obstacle > TOLERANCE_M) & (truth.data == FREE)
    in_gaps = values[narrow_gaps(truth)]
    near = metres_to(occupied, truth)[faces] <= TOLERANCE_M
    precision = 1.0 - float(wrong.sum()) / float(occupied.sum()) if occupied.any() else None
    recall = share(near)
    total = (precision or 0.0) + (recall or 0.0)
    return ObstacleQuality(
        precision,
        recall,
        2.0 * (precision or 0.0) * (recall or 0.0) / total if total > 0.0 else None,
        share(free[faces]),
        share(to_free[free] > TOLERANCE_M),
        float(wrong.sum()) * truth.resolution**2,
        share(in_gaps[in_gaps != UNKNOWN] == FREE),
    )


def narrow_gaps(truth: OccupancyGrid) -> BoolArray:
    """(H, W) free cells of gaps 0.4 to 0.8 m wide between obstacles deep enough that no disc of that width, outside
    the gap, covers it; farther than 10 cm from both sides."""
    apart = metres_to(truth.data != FREE, truth)

    def filled_by(radius_m: float) -> BoolArray:
        """Cells that no disc among the obstacles can cover."""
        filled: BoolArray = metres_to(apart > radius_m, truth) > radius_m
        return filled

    gaps: BoolArray = filled_by(0.5 * MAX_GAP_M) & ~filled_by(0.5 * MIN_GAP_M) & (truth.data == FREE)
    return gaps & (apart > TOLERANCE_M + truth.resolution)


def on_truth(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_map: SE2) -> IntArray:
    """(H, W) the map's values at the middles of the truth's cells."""
    cells = np.argwhere(np.ones(truth.shape, bool))
    return values_at(grid, T_truth_map.inverse() @ truth.centres(cells)).reshape(truth.shape).astype(np.int64)
