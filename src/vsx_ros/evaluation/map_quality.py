"""A map against the truth: how much of the world it holds, how much of that is right, how well it shows the obstacles
that the camera saw (paper, Figure 5); and pictures of both."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy.visibility import seen_cells
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

TOLERANCE_M = 0.10  # two cells: the least that makes sense for maps with 5 cm cells
MIN_RANGE_M, MAX_RANGE_M = 0.5, 3.5  # nearer, an image shows too little of a face; farther, it is too small
MIN_GAP_M, MAX_GAP_M = 0.4, 0.8  # from the width of the robot to that of a door
_VIEWER_SPACING_CELLS, _RAYS_AROUND = 4, 360  # 20 cm, 1 deg: a cell that rays miss at 3.5 m is hit from elsewhere
_HALF_VIEW_RAD, _RAYS_IN_VIEW = 0.45, 120  # a Kinect's half view minus some degrees; rays 0.4 deg apart
_MIN_VIEWS = 3  # as many as a map needs for a point
_UNKNOWN_GREY, _FREE_WHITE = 200, 255
_Metres = NDArray[np.float32]
_FOUND, _MISSED, _PHANTOM = (30, 30, 30), (40, 140, 255), (40, 40, 220)  # BGR: black, orange, red


class MapQuality(NamedTuple):
    """A map against the truth. None where the divisor is zero. coverage: share of the observable cells that are known.
    coverage_correct: known and right; an occupied cell is right within 10 cm of an obstacle, a free cell if it is at
    most 10 cm deep inside one. occupied_precision, occupied_recall: at 10 cm. free_inside_obstacle: share of the free
    cells more than 10 cm deep inside an obstacle."""

    coverage: float | None
    coverage_correct: float | None
    occupied_precision: float | None
    occupied_recall: float | None
    free_inside_obstacle: float | None


class ObstacleQuality(NamedTuple):
    """A map against the truth, at 10 cm; shares, None where the divisor is zero. precision: of occupied cells near a
    true obstacle. recall: of seen faces near an occupied cell. f1: of both. surface_free: of seen faces in a free cell.
    free_inside: of free cells deeper than 10 cm inside an obstacle. phantom_m2: area of occupied cells over 10 cm from
    any obstacle. gaps_free: of known cells in gaps 0.4 to 0.8 m wide, over 10 cm from their sides, that are free."""

    precision: float | None
    recall: float | None
    f1: float | None
    surface_free: float | None
    free_inside: float | None
    phantom_m2: float
    gaps_free: float | None


def viewing_cells(truth: OccupancyGrid, start: SE2, robot_radius_m: float) -> IntArray:
    """(N, 2) row and column of truth cells from which the robot can look around. start: the robot's start in the
    truth's frame. Raises InputError when it is not in free space."""
    clear = cv2.distanceTransform((truth.data == FREE).astype(np.uint8), cv2.DIST_L2, 5) * truth.resolution
    standable = (clear > robot_radius_m).astype(np.uint8)
    _, labels = cv2.connectedComponents(standable, connectivity=4)
    row, column = truth.cells(np.array([[start.x, start.y]]))[0]
    if not truth.contains(np.array([[row, column]]))[0] or labels[row, column] == 0:
        raise InputError(f"start ({start.x:.2f}, {start.y:.2f}) is not free in the true map; give the true start pose")
    viewers = np.argwhere(labels == labels[row, column])
    spaced = np.all(viewers % _VIEWER_SPACING_CELLS == 0, axis=1)
    return np.vstack([viewers[spaced], [[row, column]]])


def observable_cells(truth: OccupancyGrid, viewers: IntArray, sensor_range_m: float) -> BoolArray:
    """(H, W) mask of truth cells visible within range from any of the ``viewing_cells``."""
    seen = seen_cells(truth.data == OCCUPIED, viewers, sensor_range_m / truth.resolution, _RAYS_AROUND)
    return np.asarray(seen & (truth.data != UNKNOWN))


class TruthCells(NamedTuple):
    """Cells of the truth that maps are compared at. centres: (N, 2) in the frame of the maps [m]. to_obstacle_m,
    to_free_m: (N,) from each to the nearest such cell."""

    centres: Points2
    to_obstacle_m: _Metres
    to_free_m: _Metres

    @staticmethod
    def of(
        truth: OccupancyGrid, chosen: BoolArray, T_truth_map: SE2, to_obstacle: _Metres, to_free: _Metres
    ) -> "TruthCells":
        """chosen, to_obstacle, to_free: (H, W), see ``metres_to``. T_truth_map: true pose of the maps' origin."""
        centres = T_truth_map.inverse() @ truth.centres(np.argwhere(chosen))
        return TruthCells(centres, to_obstacle_m=to_obstacle[chosen], to_free_m=to_free[chosen])

    def correct_share(self, estimate: OccupancyGrid) -> float | None:
        """The share of the cells that a map knows rightly, see ``MapQuality``; None if there are none."""
        values = _values_at(estimate, self.centres)
        off_m = np.where(values == OCCUPIED, self.to_obstacle_m, self.to_free_m)
        return _share((off_m <= TOLERANCE_M) & (values != UNKNOWN))


def map_quality(estimate: OccupancyGrid, truth: OccupancyGrid, observable: BoolArray, T_truth_map: SE2) -> MapQuality:
    """Judge a map. observable: (H, W) mask over the truth. T_truth_map: true pose of the map's origin."""
    to_obstacle, to_free = metres_to(truth.data == OCCUPIED, truth), metres_to(truth.data == FREE, truth)
    cells = TruthCells.of(truth, observable, T_truth_map, to_obstacle, to_free)
    values = _values_at(estimate, cells.centres)

    def under(value: int) -> tuple[IntArray, ...]:
        """Rows and columns of the truth's cells, clipped to its edge, under the estimate's cells with the value."""
        cells = truth.cells(T_truth_map @ estimate.centres(np.argwhere(estimate.data == value)))
        return tuple(np.clip(cells, 0, np.array(truth.shape) - 1).T)

    occupied = under(OCCUPIED)
    estimated = np.zeros(truth.shape, bool)
    estimated[occupied] = True
    faces = observable & (truth.data == OCCUPIED)
    return MapQuality(
        coverage=_share(values != UNKNOWN),
        coverage_correct=cells.correct_share(estimate),
        occupied_precision=_share(to_obstacle[occupied] <= TOLERANCE_M),
        occupied_recall=_share(metres_to(estimated, truth)[faces] <= TOLERANCE_M),
        free_inside_obstacle=_share(to_free[under(FREE)] > TOLERANCE_M),
    )


def seen_faces(truth: OccupancyGrid, T_world_cams: Sequence[SE3]) -> BoolArray:
    """(H, W) cells of obstacle surface that at least three cameras see within 3.5 m, well inside their images."""
    counts = np.zeros(truth.shape, np.int64)
    blocked = truth.data != FREE
    for T in T_world_cams:
        heading = math.atan2(float(T.rotation[1, 2]), float(T.rotation[0, 2]))
        hits = _first_hits(blocked, truth, T.translation[:2], heading)
        counts[hits[:, 0], hits[:, 1]] += 1
    return np.asarray((counts >= _MIN_VIEWS) & (truth.data == OCCUPIED))


def _first_hits(blocked: BoolArray, truth: OccupancyGrid, eye: FloatArray, heading: float) -> IntArray:
    """(N, 2) the cells where rays of the field of view end, each once."""
    angles = heading + np.linspace(-_HALF_VIEW_RAD, _HALF_VIEW_RAD, _RAYS_IN_VIEW)
    steps = np.arange(0.0, MAX_RANGE_M, 0.4 * truth.resolution)
    places = eye + steps[None, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None, :]
    cells = truth.cells(places.reshape(-1, 2))
    inside = truth.contains(cells)
    solid = np.zeros(len(cells), bool)
    solid[inside] = blocked[tuple(cells[inside].T)]
    stops = solid.reshape(len(angles), len(steps))
    first = stops.argmax(axis=1)
    good = stops.any(axis=1) & (steps[first] > MIN_RANGE_M)
    return np.unique(cells.reshape(len(angles), len(steps), 2)[np.flatnonzero(good), first[good]], axis=0)


def obstacle_quality(grid: OccupancyGrid, truth: OccupancyGrid, faces: BoolArray, T_truth_map: SE2) -> ObstacleQuality:
    """Judge a map. faces: (H, W) of ``seen_faces``. T_truth_map: true pose of the map's origin."""
    values = on_truth(grid, truth, T_truth_map)
    to_obstacle, to_free = metres_to(truth.data == OCCUPIED, truth), metres_to(truth.data == FREE, truth)
    occupied, free = values == OCCUPIED, values == FREE
    wrong = occupied & (to_obstacle > TOLERANCE_M) & (truth.data == FREE)
    in_gaps = values[narrow_gaps(truth)]
    precision = 1.0 - float(wrong.sum()) / float(occupied.sum()) if occupied.any() else None
    recall = _share(metres_to(occupied, truth)[faces] <= TOLERANCE_M)
    p, r = precision or 0.0, recall or 0.0
    return ObstacleQuality(
        precision=precision, recall=recall, f1=2.0 * p * r / (p + r) if p + r > 0.0 else None,
        surface_free=_share(free[faces]), free_inside=_share(to_free[free] > TOLERANCE_M),
        phantom_m2=float(wrong.sum()) * truth.resolution**2, gaps_free=_share(in_gaps[in_gaps != UNKNOWN] == FREE),
    )  # fmt: skip


def narrow_gaps(truth: OccupancyGrid) -> BoolArray:
    """(H, W) free cells of gaps 0.4 to 0.8 m wide, farther than 10 cm from both sides. A disc between the obstacles
    covers such a cell if it is 0.4 m wide, but not if it is 0.8 m wide."""
    apart = metres_to(truth.data != FREE, truth)

    def filled_by(radius_m: float) -> BoolArray:
        """Cells that no disc between the obstacles can cover."""
        return np.asarray(metres_to(apart > radius_m, truth) > radius_m)

    gaps: BoolArray = filled_by(0.5 * MAX_GAP_M) & ~filled_by(0.5 * MIN_GAP_M) & (truth.data == FREE)
    return gaps & (apart > TOLERANCE_M + truth.resolution)


def truth_picture(truth: OccupancyGrid, faces: BoolArray) -> NDArray[np.uint8]:
    """(H, W, 3) BGR, north up: free ground white, the faces (H, W) black."""
    image = np.full((*truth.shape, 3), _UNKNOWN_GREY, np.uint8)
    image[truth.data == FREE] = _FREE_WHITE
    image[faces] = _FOUND
    return image[::-1].copy()


def map_on_truth_picture(
    grid: OccupancyGrid, truth: OccupancyGrid, faces: BoolArray, T_truth_map: SE2
) -> NDArray[np.uint8]:
    """(H, W, 3) BGR, north up: a map's obstacles black, those on free ground red, missing faces (H, W) orange.
    T_truth_map: true pose of the map's origin."""
    image = np.full((*truth.shape, 3), _UNKNOWN_GREY, np.uint8)
    values = on_truth(grid, truth, T_truth_map)
    occupied = values == OCCUPIED
    image[values == FREE] = _FREE_WHITE
    image[faces & (metres_to(occupied, truth) > TOLERANCE_M)] = _MISSED
    image[occupied] = _FOUND
    far = metres_to(truth.data == OCCUPIED, truth) > TOLERANCE_M
    image[occupied & far & (truth.data == FREE)] = _PHANTOM
    return image[::-1].copy()


def _share(hits: BoolArray) -> float | None:
    """The share of a mask that is set; None if it is empty."""
    return float(np.mean(hits)) if hits.size else None


def metres_to(cells: BoolArray, grid: OccupancyGrid) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """(H, W) distance [m] of each cell to the nearest of the given cells; infinite when there is none."""
    if not cells.any():
        return np.full(cells.shape, math.inf, np.float32)
    cells_away = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells_away * grid.resolution, np.float32)


def on_truth(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_map: SE2) -> NDArray[np.int8]:
    """(H, W) the map's values at the centres of the truth's cells, UNKNOWN outside."""
    centres = T_truth_map.inverse() @ truth.centres(np.argwhere(np.ones(truth.shape, bool)))
    return _values_at(grid, centres).reshape(truth.shape)


def _values_at(grid: OccupancyGrid, points: Points2) -> NDArray[np.int8]:
    """(N,) the map's values at points (N, 2), UNKNOWN outside."""
    cells = grid.cells(points)
    inside = grid.contains(cells)
    values = np.full(len(cells), UNKNOWN, np.int8)
    values[inside] = grid.data[tuple(cells[inside].T)]
    return values
