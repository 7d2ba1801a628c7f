"""The cells of each room of a ground map: the watershed of the distance to the walls, cut where doors are.

This is the distance-transform segmentation with a watershed (R. Bormann et al., "Room segmentation: survey,
implementation, and analysis", ICRA 2016), with furniture removed first."""

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, IntArray
from vsx_ros.config import RoomsConfig
from vsx_ros.kernels.occupancy.basins import flood_basins
from vsx_ros.occupancy.grid import FREE, OccupancyGrid


def split(grid: OccupancyGrid, config: RoomsConfig) -> IntArray:
    """(H, W) labels of the rooms of a map from 1, 0 where the ground is not free; in no particular order."""
    free = grid.data == FREE
    emptied = without_furniture(free, config.furniture_m / grid.resolution)
    padded = np.pad(emptied.astype(np.uint8), 1)
    heights = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1].astype(np.float64)
    heights *= grid.resolution
    flat = heights.ravel()
    order = np.argsort(-flat, kind="stable")
    order = order[: int(np.count_nonzero(flat > 0.0))].astype(np.int64)
    labels = flood_basins(heights, order, config.door_ratio)
    labels = _merge_small(labels, config.least_room_m2 / grid.resolution**2)
    return np.where(free, labels, 0)


def without_furniture(free: BoolArray, most_cells: float) -> BoolArray:
    """The free cells and all islands among them at most so many cells long: furniture, pillars, unseen spots. A piece
    of wall between two doors is an island, too, but longer."""
    count, islands, stats, _ = cv2.connectedComponentsWithStats((~free).astype(np.uint8), connectivity=8)
    small = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) <= most_cells
    rows, columns = free.shape
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
    small &= (left > 0) & (top > 0) & (right < columns) & (bottom < rows)
    small[0] = False
    return np.asarray(free | small[islands])


def _merge_small(labels: IntArray, least_cells: float) -> IntArray:
    """Join each basin that is too small for a room with the neighbour along its longest border, smallest first; those
    without a neighbour are no room."""
    labels = labels.copy()
    borders = _borders(labels)
    sizes = np.bincount(labels.ravel())
    into = np.arange(len(sizes))
    for label in np.argsort(sizes, kind="stable").tolist():
        if label == 0 or sizes[label] == 0 or sizes[label] >= least_cells:
            continue
        around = borders.pop(label, {})
        target = max(around, key=lambda other: (around[other], -other), default=0)
        into[into == label] = target
        sizes[target] += sizes[label]
        sizes[label] = 0
        for other, length in around.items():
            at = borders.get(other, {})
            at.pop(label, None)
            if target and other != target:
                borders[target][other] = borders[target].get(other, 0) + length
                at[target] = at.get(target, 0) + length
    return into[labels]


def _borders(labels: IntArray) -> dict[int, dict[int, int]]:
    """Label -> neighbouring label -> number of pairs of cells side by side."""
    pairs = np.concatenate([
        np.stack([labels[:, :-1].ravel(), labels[:, 1:].ravel()], axis=1),
        np.stack([labels[:-1].ravel(), labels[1:].ravel()], axis=1),
    ])  # fmt: skip
    pairs = pairs[(pairs[:, 0] != pairs[:, 1]) & (pairs > 0).all(axis=1)]
    found, counts = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    borders: dict[int, dict[int, int]] = {}
    for (a, b), n in zip(found.tolist(), counts.tolist()):
        borders.setdefault(a, {})[b] = n
        borders.setdefault(b, {})[a] = n
    return borders
