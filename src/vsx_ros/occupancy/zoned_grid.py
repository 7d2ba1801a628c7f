"""Zones laid over a ground map: what they close to the body and where they slow it.

A closed zone closes every cell that it touches, and those within a margin. The ground itself does not change: a camera
may look into a closed zone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.occupancy.zones import OUTSIDE, Zone, ZoneKind, closings, depth_m, outside_of

_PARTS = 3  # of a cell's side, where zones meet; an odd number, so that one is in the middle


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
    """A ground map with zones. Free cells of closed zones are not ``drivable``. drawn: the zones. margin_m: already
    added around closed zones. radius_m: of the body."""

    zones: ZoneCells
    drawn: tuple[Zone, ...]
    margin_m: float
    radius_m: float

    @property
    def drivable(self) -> BoolArray:
        """(H, W) free cells that no zone closes."""
        return np.asarray((self.data == FREE) & ~self.zones.closed)

    def opened_at(self, x: float, y: float) -> OccupancyGrid:
        """The same without the zones that a body at a place [m] reaches into, or whose margin holds its centre; the
        others stay closed, also those that touch one of these."""
        here, reached = self.around(x, y, 0.0), set[Zone]()
        for closing in closings(self.drawn):
            if _reaches_into(self, closing, x, y, self.radius_m) or _closed_by(here, closing, self.margin_m).any():
                reached.update(closing)
        if not reached:
            return self
        ground = OccupancyGrid(
            data=self.data, resolution=self.resolution, origin_x=self.origin_x, origin_y=self.origin_y,
            probability=self.probability,
        )  # fmt: skip
        left = [zone for zone in self.drawn if zone not in reached]
        return with_zones(ground, left, self.margin_m, self.radius_m, self.zones.version)

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
    for closing in closings(zones):
        cells = _closed_by(grid, closing, margin_m)
        closed |= cells
        if closing[0].kind is not ZoneKind.ONLY:
            owner[cells] = zones.index(closing[0])
    for zone in zones:
        if zone.kind is ZoneKind.SLOW and zone.v_m_s is not None:
            cells = _inside(grid, zone) | _near(grid, zone, margin_m + radius_m)
            v_m_s[cells] = np.minimum(v_m_s[cells], zone.v_m_s)
    looks = [_inside(grid, zone) for zone in zones if zone.kind is ZoneKind.LOOK]
    wanted = np.logical_or.reduce(looks) if looks else None
    names = tuple(zone.name for zone in zones)
    cells_of = ZoneCells(closed=closed, v_m_s=v_m_s, owner=owner, names=names, wanted=wanted, version=version)
    return ZonedGrid(
        grid.data, grid.resolution, grid.origin_x, grid.origin_y, grid.probability,
        zones=cells_of, drawn=tuple(zones), margin_m=margin_m, radius_m=radius_m,
    )  # fmt: skip


def _closed_by(grid: OccupancyGrid, closing: tuple[Zone, ...], margin_m: float) -> BoolArray:
    """(H, W) cells that one of the ``closings`` closes."""
    if closing[0].kind is not ZoneKind.ONLY:
        (zone,) = closing
        cells = _near(grid, zone, margin_m)
        return cells | _inside(grid, zone) if zone.kind is ZoneKind.NO_GO else cells
    allowed = [_inside(grid, zone) & ~_near(grid, zone, margin_m) for zone in closing]
    if len(closing) > 1:
        allowed.append(_inside_together(grid, closing, margin_m))
    return np.asarray(~np.logical_or.reduce(allowed))


def entered(zones: Sequence[Zone], x: float, y: float, radius_m: float, cell_m: float) -> tuple[str, ...]:
    """The names of the closed zones that a round body at x, y [m] reaches into, and "only here" if it reaches out of
    all zones of the kind ONLY. cell_m: size of the cells of its map, which begins whole cells from the origin."""
    (row, column), last = (np.floor((np.array([y, x]) + way_m) / cell_m).astype(int) for way_m in (-radius_m, radius_m))
    body = OccupancyGrid(
        data=np.zeros(last - (row, column) + 1, np.int8), resolution=cell_m,
        origin_x=float(column * cell_m), origin_y=float(row * cell_m),
    )  # fmt: skip
    reached = [closing[0] for closing in closings(zones) if _reaches_into(body, closing, x, y, radius_m)]
    return tuple(OUTSIDE if zone.kind is ZoneKind.ONLY else zone.name for zone in reached)


def _reaches_into(grid: OccupancyGrid, closing: tuple[Zone, ...], x: float, y: float, radius_m: float) -> bool:
    """Whether a round body at x, y [m] reaches into the ground that one of the ``closings`` closes. What the grid takes
    for no gap between zones to stay in is none."""
    if closing[0].kind is not ZoneKind.ONLY:
        return depth_m(closing[0], x, y) > -radius_m
    body, outside = grid.around(x, y, radius_m), outside_of(closing, x, y, radius_m)
    cells = body.cells(outside)
    if not len(cells) or not body.contains(cells).all():
        return len(cells) > 0
    return bool(_closed_by(body, closing, 0.0)[tuple(cells.T)].any())


def _inside(grid: OccupancyGrid, zone: Zone) -> BoolArray:
    """(H, W) cells with their centre in the polygon."""
    borders = np.zeros((grid.shape[0], grid.shape[1] + 1), np.bool_)  # left of each cell, and right of the last
    y = grid.origin_y + (np.arange(grid.shape[0]) + 0.5) * grid.resolution
    corners = np.array(zone.points)
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        rows = np.flatnonzero((a[1] > y) != (b[1] > y))
        x = a[0] + (y[rows] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
        columns = np.ceil((x - grid.origin_x) / grid.resolution - 0.5)
        borders[rows, np.clip(columns, 0, grid.shape[1]).astype(np.int64)] ^= True
    return np.logical_xor.accumulate(borders[:, :-1], axis=1)


def _inside_together(grid: OccupancyGrid, zones: tuple[Zone, ...], margin_m: float) -> BoolArray:
    """(H, W) cells near two polygons that are farther than margin_m from the ground outside the union of all. A gap
    between two that is narrower than two parts of a cell may count as none, and one narrower than a part does: corners
    drawn by hand, or moved with the map, hardly meet."""
    part_m = grid.resolution / _PARTS
    reach = math.ceil((margin_m + math.sqrt(0.5) * grid.resolution) / part_m) + 2
    beyond = math.ceil((reach + 1) / _PARTS)
    rows, columns = _meeting(grid, zones, beyond * grid.resolution)
    shape = np.array([rows.stop - rows.start, columns.stop - columns.start])
    together = np.zeros(grid.shape, np.bool_)
    if not shape.all():
        return together
    fine = OccupancyGrid(
        data=np.zeros(_PARTS * (shape + 2 * beyond), np.int8), resolution=part_m,
        origin_x=grid.origin_x + (columns.start - beyond) * grid.resolution,
        origin_y=grid.origin_y + (rows.start - beyond) * grid.resolution,
    )  # fmt: skip
    inside = np.zeros(fine.shape, np.bool_)
    for zone in zones:
        inside |= _inside(fine, zone) | _around_border(fine, zone, 0.5 * part_m)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    middles = slice(_PARTS * beyond + _PARTS // 2, -_PARTS * beyond, _PARTS)
    together[rows, columns] = cv2.erode(inside.astype(np.uint8), disc)[middles, middles] > 0
    return together


def _meeting(grid: OccupancyGrid, zones: tuple[Zone, ...], reach_m: float) -> tuple[slice, slice]:
    """Rows and columns of the grid that hold all its cells within reach_m of the boxes around two polygons."""
    corners = [np.array(zone.points) for zone in zones]
    boxes = [(points.min(axis=0) - reach_m, points.max(axis=0) + reach_m) for points in corners]
    pairs = [(np.maximum(a, c), np.minimum(b, d)) for (a, b), (c, d) in itertools.combinations(boxes, 2)]
    meeting = np.array([pair for pair in pairs if (pair[0] <= pair[1]).all()]).reshape(-1, 2, 2)
    if not len(meeting):
        return slice(0, 0), slice(0, 0)
    first, last = grid.cells(np.array([meeting[:, 0].min(axis=0), meeting[:, 1].max(axis=0)]))
    (top, left), (bottom, right) = np.clip([first, last + 1], 0, grid.shape).tolist()
    return slice(top, bottom), slice(left, right)


def _near(grid: OccupancyGrid, zone: Zone, margin_m: float) -> BoolArray:
    """(H, W) cells that have a point within margin_m of the line or the border."""
    return _around_border(grid, zone, margin_m + math.sqrt(0.5) * grid.resolution)


def _around_border(grid: OccupancyGrid, zone: Zone, reach_m: float) -> BoolArray:
    """(H, W) cells with their centre within reach_m of the line or the border."""
    mask = np.zeros(grid.shape, np.bool_)
    corners = np.array(zone.points)
    ends = corners[1:] if zone.kind is ZoneKind.WALL else np.roll(corners, -1, axis=0)
    for a, b in zip(corners, ends):
        low, high = grid.cells(np.array([np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m]))
        low, high = np.maximum(low, 0), np.minimum(high + 1, grid.shape)
        if (low >= high).any():
            continue
        rows, columns = (np.arange(low[k], high[k]) for k in (0, 1))
        x = grid.origin_x + (columns + 0.5) * grid.resolution
        y = grid.origin_y + (rows + 0.5) * grid.resolution
        mask[low[0] : high[0], low[1] : high[1]] |= _to_segment(x[None, :], y[:, None], a, b) <= reach_m
    return mask


def _to_segment(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances [m] from places to a segment."""
    edge = b - a
    ratio = ((x - a[0]) * edge[0] + (y - a[1]) * edge[1]) / max(float(edge @ edge), 1e-12)
    ratio = np.clip(ratio, 0.0, 1.0)
    return np.asarray(np.hypot(x - a[0] - ratio * edge[0], y - a[1] - ratio * edge[1]))


def speed_limits(grid: OccupancyGrid, positions: Points2) -> FloatArray:
    """(N,) speed limits [m/s] of the slow zones at places (N, 2) [m]; infinite elsewhere."""
    limits = np.full(len(positions), np.inf)
    if isinstance(grid, ZonedGrid):
        cells = grid.cells(positions)
        inside = grid.contains(cells)
        limits[inside] = grid.zones.v_m_s[tuple(cells[inside].T)]
    return limits
