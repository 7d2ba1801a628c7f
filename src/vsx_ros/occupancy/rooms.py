"""The rooms of a ground map, with numbers and names that stay while it grows."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import RoomsConfig
from vsx_ros.occupancy.grid import UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.room_cells import split

_HULL_GROW_M = 0.3  # of a room's outline: its walls, and ground that is seen only at its edge
_SIMPLE_M = 0.05  # tolerance of outlines
MOST_ROOMS = 255  # grey values of the picture that they are saved as

_Claim = tuple[bool, int, int, int]  # of a room to a label: whether it has a name, cells, label, number


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
    """labels: (H, W) number of the room of each free cell of ``grid``, 0 elsewhere. absent: rooms with names that are
    not in this map, as they were last."""

    grid: OccupancyGrid
    labels: IntArray
    rooms: tuple[Room, ...]
    absent: tuple[Room, ...] = ()

    def named(self, name: str) -> Room | None:
        """The room of this name, however it is capitalised; None when there is none."""
        wanted = name.strip().casefold()
        return next((room for room in self.rooms if room.name.casefold() == wanted), None)

    def at(self, x: float, y: float) -> Room | None:
        """The room of a place [m]; None on ground of no room."""
        number = _label_at(self.grid, self.labels, (x, y))
        return next((room for room in self.rooms if room.number == number), None)


class RoomTracker:
    """Splits one map after another; a room keeps its number and name while the map grows. One that was part of another
    for a while, or out of the map, gets both back. Call ``update`` with each new map, ``rename`` at any time between.
    current: the last split map."""

    def __init__(self, config: RoomsConfig) -> None:
        self._config = config
        self._names: dict[int, str] = {}
        self._last_number = 0
        self._last_seen: dict[int, Room] = {}  # by number
        self.current: RoomMap | None = None

    def update(self, grid: OccupancyGrid) -> RoomMap:
        """The rooms of the newest map."""
        labels = split(grid, self._config)
        numbers = self._numbers(grid, labels)
        labels = np.array(numbers, np.int64)[labels]
        found = [int(number) for number in np.unique(labels) if number]
        rooms = tuple(_described(grid, labels, number, self._name(number)) for number in found)
        self._last_seen.update((room.number, room) for room in rooms)
        storable = [number for number in self._names if number in self._last_seen and number <= MOST_ROOMS]
        away = [self._last_seen[number] for number in storable if number not in found]
        absent = tuple(room._replace(name=self._name(room.number)) for room in away)
        self.current = RoomMap(grid, labels, rooms, absent)
        return self.current

    def rename(self, number: int, name: str) -> None:
        """Name a room; it loses an earlier name, and so does another room of this name."""
        self._names = {k: v for k, v in self._names.items() if v.casefold() != name.casefold()}
        self._names[number] = name
        if self.current is not None:
            rooms = tuple(room._replace(name=self._name(room.number)) for room in self.current.rooms)
            absent = tuple(room for room in self.current.absent if room.number in self._names)
            self.current = self.current._replace(rooms=rooms, absent=absent)

    def resume(self, saved: RoomMap) -> None:
        """Continue from the rooms of a saved map."""
        self.current = saved
        known = (*saved.rooms, *saved.absent)
        self._last_seen = {room.number: room for room in known}
        self._last_number = max([0, *self._last_seen])
        self._names = {room.number: room.name for room in known if room.name != _default(room.number)}

    def _name(self, number: int) -> str:
        return self._names.get(number, _default(number))

    def _numbers(self, grid: OccupancyGrid, labels: IntArray) -> list[int]:
        """For each label its number: that of the room of the last map that it shares most ground with, else of an
        absent room at its last place. Named rooms choose first."""
        most = int(labels.max(initial=0))
        numbers = [0] * (most + 1)
        taken: set[int] = set()
        absent = self._absent(grid, labels)
        for _, _, label, number in (
            *sorted(self._overlaps(grid, labels, absent), reverse=True), *sorted(absent, reverse=True)
        ):  # fmt: skip
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

    def _absent(self, grid: OccupancyGrid, labels: IntArray) -> list[_Claim]:
        """For each room that was not in the last map the label at its last place, and its size then."""
        here = {room.number for room in self.current.rooms} if self.current is not None else set()
        return [
            (room.number in self._names, round(room.area_m2 / grid.resolution**2), label, room.number)
            for room in self._last_seen.values()
            if room.number not in here and (label := _label_at(grid, labels, room.place))
        ]

    def _overlaps(self, grid: OccupancyGrid, labels: IntArray, absent: Sequence[_Claim]) -> list[_Claim]:
        """Each pair that shares a quarter of either room, and the shared cells without those of absent rooms."""
        if self.current is None:
            return []
        others = Counter[int]()
        for _, size, label, _ in absent:
            others[label] += size
        cells = np.argwhere(labels)
        before_grid, before = self.current.grid, self.current.labels
        at = before_grid.cells(grid.centres(cells))
        inside = before_grid.contains(at)
        cells, at = cells[inside], at[inside]
        pairs = np.stack([labels[tuple(cells.T)], before[tuple(at.T)]], axis=1)
        found, counts = np.unique(pairs[pairs[:, 1] > 0], axis=0, return_counts=True)
        now, then = np.bincount(labels.ravel()), np.bincount(before.ravel())
        return [
            (number in self._names, n - others[label], label, number)
            for (label, number), n in zip(found.tolist(), counts.tolist())
            if n >= 0.25 * min(now[label], then[number])
        ]


def _label_at(grid: OccupancyGrid, labels: IntArray, place: tuple[float, float]) -> int:
    (cell,) = grid.cells(np.array([place]))
    return int(labels[tuple(cell)]) if grid.contains(cell[None])[0] else 0


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
