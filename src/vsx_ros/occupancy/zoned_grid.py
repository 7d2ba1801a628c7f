"""Zones laid over a ground map: what they close to the body and where they slow it.

A closed zone closes every cell that it touches, and those within a margin. The ground itself does not change: a camera
may look into a closed zone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.kernels.occupancy.clearance import DistanceField, signed_distance
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.occupancy.zones import OUTSIDE, Zone, ZoneKind

_SUBPIXEL_BITS = 8  # OpenCV's fixed point
_REACH_M = 1.0  # farther zones do not matter
_GIVE_M = 0.02  # as in the planner's corridor: interpolation near start and goal; the margin is larger
_DEEPER_M, _LEAVE_M = 0.10, 2.0  # what a base that stands in a zone may do on its way out: a bend, and its length


class ZoneCells(NamedTuple):
    """The zones on the cells of a grid. closed: (H, W) where no part of the body may be. v_m_s: (H, W) speed limit for
    the base's centre, infinite without one. owner: (H, W) index in ``names`` of the zone that closes a cell; -1: cells
    outside all zones of the kind ONLY. wanted: (H, W) where unknown ground is worth a look; None: everywhere. version:
    of the user's drawing; it stays when zones only move with the map."""

    closed: BoolArray
    v_m_s: FloatArray
    owner: FloatArray
    names: tuple[str, ...]
    wanted: BoolArray | None
    version: int

    def cut(self, rows: slice, columns: slice) -> ZoneCells:
        """The same on a part of the grid."""
        part, wanted = (rows, columns), None if self.wanted is None else self.wanted[rows, columns]
        v_m_s, owner = self.v_m_s[part], self.owner[part]
        return self._replace(closed=self.closed[part], v_m_s=v_m_s, owner=owner, wanted=wanted)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ZonedGrid(OccupancyGrid):
    """A ground map with zones. Free cells of closed zones are not ``drivable``. margin_m: already added around closed
    zones."""

    zones: ZoneCells
    margin_m: float

    @property
    def drivable(self) -> BoolArray:
        """(H, W) free cells that no zone closes."""
        return np.asarray((self.data == FREE) & ~self.zones.closed)

    def opened_at(self, x: float, y: float) -> OccupancyGrid:
        """The same without the closed area that contains or is nearest to a place [m]; the others stay."""
        labels = cv2.connectedComponents(self.zones.closed.astype(np.uint8), connectivity=8)[1]
        cells = np.argwhere(self.zones.closed)
        if not len(cells):
            return self
        nearest = cells[int(np.argmin(np.hypot(*(self.centres(cells) - [x, y]).T)))]
        still = self.zones.closed & (labels != labels[tuple(nearest)])
        return replace(self, zones=self.zones._replace(closed=still))

    def _fields_of(self, rows: slice, columns: slice) -> dict[str, Any]:
        return {**OccupancyGrid._fields_of(self, rows, columns), "zones": self.zones.cut(rows, columns)}


def with_zones(
    grid: OccupancyGrid, zones: Sequence[Zone], margin_m: float, radius_m: float, version: int = 0
) -> OccupancyGrid:
    """The grid with zones in its own map. margin_m: kept from closed zones in addition. radius_m: of the body, which is
    slow as soon as it reaches into a slow zone."""
    if not zones:
        return grid
    closed, owner = np.zeros(grid.shape, np.bool_), np.full(grid.shape, -1.0)
    v_m_s = np.full(grid.shape, np.inf)
    allowed = [zone for zone in zones if zone.kind is ZoneKind.ONLY]
    if allowed:
        inside = np.zeros(grid.shape, np.bool_)
        for zone in allowed:
            inside |= _inside(grid, zone) & ~_near(grid, zone, margin_m)
        closed |= ~inside
    for number, zone in enumerate(zones):
        if zone.kind is ZoneKind.SLOW and zone.v_m_s is not None:
            cells = _inside(grid, zone) | _near(grid, zone, margin_m + radius_m)
            v_m_s[cells] = np.minimum(v_m_s[cells], zone.v_m_s)
        elif zone.kind in (ZoneKind.NO_GO, ZoneKind.WALL):
            cells = _near(grid, zone, margin_m)
            if zone.kind is ZoneKind.NO_GO:
                cells |= _inside(grid, zone)
            closed |= cells
            owner[cells] = number
    looks = [_inside(grid, zone) for zone in zones if zone.kind is ZoneKind.LOOK]
    wanted = np.logical_or.reduce(looks) if looks else None
    names = tuple(zone.name for zone in zones)
    cells_of = ZoneCells(closed=closed, v_m_s=v_m_s, owner=owner, names=names, wanted=wanted, version=version)
    return ZonedGrid(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, grid.probability, zones=cells_of, margin_m=margin_m
    )


def _inside(grid: OccupancyGrid, zone: Zone) -> BoolArray:
    """(H, W) cells with their centre in the polygon or on its border."""
    mask = np.zeros(grid.shape, np.uint8)
    corners = (np.array(zone.points) - [grid.origin_x, grid.origin_y]) / grid.resolution - 0.5
    cv2.fillPoly(mask, [np.rint(corners * (1 << _SUBPIXEL_BITS)).astype(np.int32)], 1, cv2.LINE_8, _SUBPIXEL_BITS)
    return mask > 0


def _near(grid: OccupancyGrid, zone: Zone, margin_m: float) -> BoolArray:
    """(H, W) cells that have a point within margin_m of the line or the border."""
    mask = np.zeros(grid.shape, np.bool_)
    reach = margin_m + math.sqrt(0.5) * grid.resolution
    corners = np.array(zone.points)
    ends = corners[1:] if zone.kind is ZoneKind.WALL else np.roll(corners, -1, axis=0)
    for a, b in zip(corners, ends):
        low, high = grid.cells(np.array([np.minimum(a, b) - reach, np.maximum(a, b) + reach]))
        low, high = np.maximum(low, 0), np.minimum(high + 1, grid.shape)
        if (low >= high).any():
            continue
        rows, columns = (np.arange(low[k], high[k]) for k in (0, 1))
        x = grid.origin_x + (columns + 0.5) * grid.resolution
        y = grid.origin_y + (rows + 0.5) * grid.resolution
        mask[low[0] : high[0], low[1] : high[1]] |= _to_segment(x[None, :], y[:, None], a, b) <= reach
    return mask


def _to_segment(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances [m] from places to a segment."""
    edge = b - a
    ratio = ((x - a[0]) * edge[0] + (y - a[1]) * edge[1]) / max(float(edge @ edge), 1e-12)
    ratio = np.clip(ratio, 0.0, 1.0)
    return np.asarray(np.hypot(x - a[0] - ratio * edge[0], y - a[1] - ratio * edge[1]))


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
        """The name of a zone that the body reaches into, the margin left out; empty if there is none."""
        grid = self._grid
        if not isinstance(grid, ZonedGrid):
            return ""
        clearance = float(self.clearance(np.array([[x, y]]))[0])
        return self.zone_near(x, y) if clearance < self._radius_m - grid.margin_m else ""

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

        A body that starts in a zone may leave it: at most 10 cm deeper, within 2 m and twice its depth. Once outside,
        it stays outside."""
        if self._field is None or not len(positions):
            return None
        clearance = self.clearance(positions)
        way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
        wrong = clearance < self._radius_m - _GIVE_M
        if wrong[0]:
            outside = np.flatnonzero(~wrong)
            leaving = slice(0, int(outside[0]) if len(outside) else len(wrong))
            late = way_m[leaving] > _LEAVE_M + 2.0 * (self._radius_m - clearance[0])
            wrong[leaving] = (clearance[leaving] < clearance[0] - _DEEPER_M) | late
        if not wrong.any():
            return None
        at = int(np.argmax(wrong))
        return Entry(float(way_m[at]), self.zone_near(*positions[at].tolist()))


def speed_limits(grid: OccupancyGrid, positions: Points2) -> FloatArray:
    """(N,) speed limits [m/s] of the slow zones at places (N, 2) [m]; infinite elsewhere."""
    limits = np.full(len(positions), np.inf)
    if isinstance(grid, ZonedGrid):
        cells = grid.cells(positions)
        inside = grid.contains(cells)
        limits[inside] = grid.zones.v_m_s[tuple(cells[inside].T)]
    return limits
