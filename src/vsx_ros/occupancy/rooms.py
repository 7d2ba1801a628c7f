"""The ground map split into rooms: the watershed of the distance to the walls, cut where doors are.

This is the distance-transform segmentation with a watershed (R. Bormann et al., "Room segmentation: survey,
implementation, and analysis", ICRA 2016), with furniture removed first."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config import RoomsConfig
from vsx_ros.kernels.occupancy.basins import flood_basins
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid

_HULL_GROW_M = 0.3  # of a room's outline: its walls, and ground that is seen only at its edge
_SIMPLE_M = 0.05  # tolerance of outlines
MOST_ROOMS = 255  # grey values of the picture that they are saved as


class Room(NamedTuple):
    """number: stays with the room while the map grows. name: as its user named it, else 'room 3'. area_m2: of its free
    ground. known_ratio: its share of that and of the unknown ground within its convex hull that no wall divides from
    it. place: x, y [m] of its widest spot. outline: corners [m] of its convex hull."""

    number: int
    name: str
    area_m2: float
    known_ratio: float
    place: tuple[float, float]
    outline: tuple[tuple[float, float], ...]


class RoomMap(NamedTuple):
    """labels: (H, W) number of the room of each free cell of ``grid``, 0 elsewhere."""

    grid: OccupancyGrid
    labels: IntArray
    rooms: tuple[Room, ...]

    def named(self, name: str) -> Room | None:
        """The room of this name, however it is capitalised; None when there is none."""
        wanted = name.strip().casefold()
        return next((room for room in self.rooms if room.name.casefold() == wanted), None)

    def at(self, x: float, y: float) -> Room | None:
        """The room of a place [m]; None on ground of no room."""
        (cell,) = self.grid.cells(np.array([[x, y]]))
        number = int(self.labels[tuple(cell)]) if self.grid.contains(cell[None])[0] else 0
        return next((room for room in self.rooms if room.number == number), None)


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


class RoomTracker:
    """Splits one map after another; a room keeps its number and name while the map grows. Call ``update`` with each new
    map, ``rename`` at any time between. current: the last split map."""

    def __init__(self, config: RoomsConfig) -> None:
        self._config = config
        self._names: dict[int, str] = {}
        self._last_number = 0
        self.current: RoomMap | None = None

    def update(self, grid: OccupancyGrid) -> RoomMap:
        """The rooms of the newest map."""
        labels = split(grid, self._config)
        numbers = self._numbers(grid, labels)
        labels = np.array(numbers, np.int64)[labels]
        self.current = RoomMap(grid, labels, self._described(grid, labels))
        return self.current

    def rename(self, number: int, name: str) -> None:
        """Name a room; it loses an earlier name, and so does another room of this name."""
        self._names = {k: v for k, v in self._names.items() if v.casefold() != name.casefold()}
        self._names[number] = name
        if self.current is not None:
            rooms = tuple(room._replace(name=self._name(room.number)) for room in self.current.rooms)
            self.current = self.current._replace(rooms=rooms)

    def resume(self, saved: RoomMap) -> None:
        """Continue from the rooms of a saved map."""
        self.current = saved
        self._last_number = max([0, *(room.number for room in saved.rooms)])
        self._names = {room.number: room.name for room in saved.rooms if room.name != _default(room.number)}

    def _name(self, number: int) -> str:
        return self._names.get(number, _default(number))

    def _numbers(self, grid: OccupancyGrid, labels: IntArray) -> list[int]:
        """For each label its number: that of the earlier room that it shares most ground with. Named rooms choose
        first."""
        most = int(labels.max(initial=0))
        numbers = [0] * (most + 1)
        taken: set[int] = set()
        for _, _, label, number in sorted(self._overlaps(grid, labels), reverse=True):
            if not numbers[label] and number not in taken:
                numbers[label] = number
                taken.add(number)
        sizes = np.bincount(labels.ravel(), minlength=most + 1)
        for label in np.argsort(-sizes[1:], kind="stable") + 1:
            if sizes[label] and not numbers[label]:
                numbers[label] = self._next_number(numbers)
        return numbers

    def _next_number(self, used: Sequence[int]) -> int:
        """One that no room has had yet. If a file can hold none of these: one that no room has now, nor a name."""
        if self._last_number < MOST_ROOMS:
            self._last_number += 1
            return self._last_number
        return min(set(range(1, MOST_ROOMS + len(used) + 1)) - set(used) - self._names.keys())

    def _overlaps(self, grid: OccupancyGrid, labels: IntArray) -> list[tuple[bool, int, int, int]]:
        """(whether it has a name, shared cells, label, number) of each pair that shares a quarter of either room."""
        if self.current is None:
            return []
        cells = np.argwhere(labels)
        before_grid, before = self.current.grid, self.current.labels
        at = before_grid.cells(grid.centres(cells))
        inside = before_grid.contains(at)
        cells, at = cells[inside], at[inside]
        pairs = np.stack([labels[tuple(cells.T)], before[tuple(at.T)]], axis=1)
        found, counts = np.unique(pairs[pairs[:, 1] > 0], axis=0, return_counts=True)
        now, then = np.bincount(labels.ravel()), np.bincount(before.ravel())
        return [
            (number in self._names, n, label, number)
            for (label, number), n in zip(found.tolist(), counts.tolist())
            if n >= 0.25 * min(now[label], then[number])
        ]

    def _described(self, grid: OccupancyGrid, labels: IntArray) -> tuple[Room, ...]:
        numbers = [int(number) for number in np.unique(labels) if number]
        return tuple(_described(grid, labels, number, self._name(number)) for number in numbers)


def _default(number: int) -> str:
    return f"room {number}"


def _described(grid: OccupancyGrid, labels: IntArray, number: int, name: str) -> Room:
    mine = labels == number
    cells = np.argwhere(mine)
    (top, left), (bottom, right) = cells.min(axis=0), cells.max(axis=0)
    box = slice(top, bottom + 1), slice(left, right + 1)
    hull = cv2.convexHull((cells[:, ::-1] - [left, top]).astype(np.int32)).reshape(-1, 2)
    inside = np.zeros((bottom - top + 1, right - left + 1), np.uint8)
    cv2.fillConvexPoly(inside, hull, 1)
    open_ground = mine[box] | ((inside > 0) & (grid.data[box] == UNKNOWN) & (labels[box] == 0))
    _, parts = cv2.connectedComponents(open_ground.astype(np.uint8), connectivity=4)
    whole = np.count_nonzero(open_ground & np.isin(parts, parts[mine[box]]))
    known = len(cells) / whole
    away = cv2.distanceTransform(np.pad(mine[box].astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(away)), away.shape)
    x, y = grid.centres(np.array([[top + row, left + column]]))[0].tolist()
    return Room(
        number=number, name=name, area_m2=round(len(cells) * grid.resolution**2, 2), known_ratio=round(known, 3),
        place=(round(x, 3), round(y, 3)), outline=_outline(grid, hull + [left, top]),
    )  # fmt: skip


def _outline(grid: OccupancyGrid, hull: IntArray) -> tuple[tuple[float, float], ...]:
    """The convex hull of cells (N, 2) of column and row, grown by the walls around it [m]."""
    corners = grid.centres(hull[:, ::-1])
    middle = corners.mean(axis=0)
    away = corners - middle
    lengths = np.maximum(np.hypot(*away.T), 1e-9)[:, None]
    grown: FloatArray = middle + away * (1.0 + _HULL_GROW_M * math.sqrt(2.0) / lengths)
    simple = cv2.approxPolyDP(grown.astype(np.float32), _SIMPLE_M, True).reshape(-1, 2)
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y in simple)
