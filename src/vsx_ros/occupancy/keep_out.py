"""Ways and closed zones: a body keeps out of them, and leaves one in which it stands."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField, signed_distance
from vsx_ros.occupancy.distance import GIVE_M, clearance_field, relax_need
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.zoned_grid import ZonedGrid
from vsx_ros.occupancy.zones import OUTSIDE

_REACH_M = 1.0  # farther zones do not matter
_ROOM_M = 0.10  # around a body where its way out ends; a planner needs less
_DEEPER_M, _LEAVE_M = 0.10, 2.0  # what a base that stands in a zone may do on its way out: a bend, and its length
_STEPS = np.ones((3, 3), np.uint8), np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)  # in turn: almost a circle


class Entry(NamedTuple):
    """Where a way enters a zone: after so many metres, and the zone's name."""

    ahead_m: float
    zone: str


class KeepOut:
    """The closed zones of a grid, for a round body of radius_m."""

    def __init__(self, grid: OccupancyGrid, radius_m: float) -> None:
        self._grid, self._radius_m = grid, radius_m
        self._field: DistanceField | None = None
        if isinstance(grid, ZonedGrid) and grid.zones.closed.any():
            values = signed_distance(grid.zones.closed, math.ceil(_REACH_M / grid.resolution)) * grid.resolution
            self._field = DistanceField(values, grid.resolution, grid.origin_x, grid.origin_y)

    def clearance(self, positions: Points2) -> FloatArray:
        """(N,) distances [m] from places (N, 2) to the closed cells, negative inside; cut off at 1 m."""
        positions = np.asarray(positions, float).reshape(-1, 2)
        if self._field is None:
            return np.full(len(positions), _REACH_M)
        within = self._grid.contains(self._grid.cells(positions))
        return np.where(within, self._field.at(positions), _REACH_M)

    def zone_at(self, x: float, y: float) -> str:
        """The name of a zone that the body reaches into, the margin left out, or whose margin holds its centre; empty
        if there is none."""
        grid = self._grid
        if not isinstance(grid, ZonedGrid):
            return ""
        clearance = float(self.clearance(np.array([[x, y]]))[0])
        return self.zone_near(x, y) if clearance < max(self._radius_m - grid.margin_m, 0.0) else ""

    def zone_near(self, x: float, y: float) -> str:
        """The name of the closed zone nearest to a place [m]; empty if there is none."""
        grid = self._grid
        cells = np.argwhere(grid.zones.closed) if isinstance(grid, ZonedGrid) else np.zeros((0, 2), np.int64)
        if not isinstance(grid, ZonedGrid) or not len(cells):
            return ""
        row, column = cells[int(np.argmin(np.hypot(*(grid.centres(cells) - [x, y]).T)))]
        owner = int(grid.zones.owner[row, column])
        return grid.zones.names[owner] if owner >= 0 else OUTSIDE

    def entered(self, positions: Points2) -> Entry | None:
        """Where on a way (N, 2) [m] the body reaches into a zone; None if it never does.

        A body that starts in a zone may leave it: at most 10 cm farther from a way out, within 2 m and twice that
        way; without a way out it stays within 10 cm. Once outside, it stays outside. All other zones stay closed; from
        the margin of one it comes no nearer to it than the margin allows."""
        positions, grid = np.asarray(positions, float).reshape(-1, 2), self._grid
        if self._field is None or not len(positions) or not isinstance(grid, ZonedGrid):
            return None
        clearance, need = self.clearance(positions), self._radius_m - GIVE_M
        wrong = clearance < need
        if not wrong[0]:
            return self._entry(positions, wrong)
        x, y = positions[0].tolist()
        opened = grid.opened_at(x, y)
        others = self if opened is grid else KeepOut(opened, self._radius_m)
        leaving = _until_right(wrong)
        on_way_out, out_m = _on_way_out(grid, opened, self._radius_m, positions[leaving])
        late = _lengths(positions[leaving]) > _LEAVE_M + 2.0 * (out_m + self._radius_m)
        wrong[leaving] = late | ~on_way_out
        if out_m == 0.0:  # the centre stands outside, or there is no way out
            wrong[leaving] |= clearance[leaving] < clearance[0] - _DEEPER_M
        beside = others.clearance(positions)
        closed = beside < need
        from_margin = _until_right(closed)
        closed[from_margin] = beside[from_margin] < min(beside[0] - GIVE_M, self._radius_m - grid.margin_m)
        found = [entry for entry in (others._entry(positions, closed), self._entry(positions, wrong)) if entry]
        return min(found, key=lambda entry: entry.ahead_m) if found else None

    def _entry(self, positions: Points2, wrong: BoolArray) -> Entry | None:
        """The first place of a way where something is wrong (N,), and the zone nearest to it."""
        if not wrong.any():
            return None
        at = int(np.argmax(wrong))
        return Entry(float(_lengths(positions)[at]), self.zone_near(*positions[at].tolist()))


def _until_right(wrong: BoolArray) -> slice:
    """The places of a way (N,) before the first where nothing is wrong."""
    return slice(0, len(wrong) if wrong.all() else int(np.argmin(wrong)))


def _lengths(positions: Points2) -> FloatArray:
    """(N,) length of a way [m] up to each of its places (N, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])


def _on_way_out(grid: ZonedGrid, opened: OccupancyGrid, radius_m: float, positions: Points2) -> tuple[BoolArray, float]:
    """(N,) from which places (N, 2) [m] a way out of the zones is at most 10 cm longer than from the first, and its
    length from there; without one, which lie within 10 cm of the first, and 0. The way leads past obstacles, and past
    the zones that ``opened`` keeps closed.

    It leads to the nearest ground outside; where the places are not on it, because that is a crack in a wall, a strip
    beside one, or unknown, also to known ground with room for the body, as the body can drive."""
    closed = opened.zones.closed if isinstance(opened, ZonedGrid) else np.zeros(grid.shape, np.bool_)
    cells, ground = np.clip(grid.cells(positions), 0, np.array(grid.shape) - 1), (grid.data != OCCUPIED) & ~closed
    deeper, room_m, at = round(_DEEPER_M / grid.resolution), radius_m + _ROOM_M, tuple(cells.T)
    near, near_cells = _way_out(ground, ~grid.zones.closed, cells[0].tolist(), ground, deeper)
    if not near_cells or near[at].all():
        return near[at], near_cells * grid.resolution
    field, outside = (clearance_field(known, room_m + grid.resolution) for known in (opened, grid))
    needed_m = np.full(field.values.shape, radius_m - GIVE_M)
    relax_need(needed_m, field, SE2(float(positions[0, 0]), float(positions[0, 1])), radius_m - GIVE_M)
    passable, roomy = (field.values >= needed_m)[1:-1, 1:-1], (outside.values >= room_m)[1:-1, 1:-1]
    far, far_cells = _way_out(passable, roomy, cells[0].tolist(), ground, deeper)
    return near[at] | far[at], max(near_cells * grid.resolution, far_cells * grid.resolution - room_m)


def _way_out(
    passable: BoolArray, outside: BoolArray, cell: list[int], ground: BoolArray, deeper: int
) -> tuple[BoolArray, int]:
    """(H, W) cells from where the way over passable cells to one outside is longer than from a cell by at most so many
    cells, which lie on the ground, and its length from there [cells]; without a way, those around the cell, and 0."""
    way, row, column = passable.astype(np.uint8), *cell
    way[row, column] = 1
    reached, step = way * outside, 0
    while not reached[row, column]:
        grown = cv2.dilate(reached, _STEPS[step % 2]) & way
        if step % 2 == 0 and np.array_equal(grown, reached):
            reached, step = np.zeros_like(way), 0
            reached[row, column] = 1
        else:
            reached, step = grown, step + 1
    for more in range(deeper):
        reached = cv2.dilate(reached, _STEPS[(step + more) % 2]) & (way | ground)
    return reached > 0, step
