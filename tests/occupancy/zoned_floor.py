"""Zones on a floor that is free all over."""

import numpy as np

from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zoned_grid import ZonedGrid, with_zones
from vsx_ros.occupancy.zones import Zone, ZoneKind

BODY_M, MARGIN_M, CELL_M = 0.18, 0.05, 0.05
FLOOR = OccupancyGrid(np.zeros((160, 160), np.int8), CELL_M, -4.0, -4.0)


def square(half_m: float, kind: ZoneKind = ZoneKind.NO_GO, v_m_s: float | None = None, x: float = 0.0) -> Zone:
    corners = ((x - half_m, -half_m), (x + half_m, -half_m), (x + half_m, half_m), (x - half_m, half_m))
    return Zone(kind.value, kind, corners, v_m_s)


def zoned(*zones: Zone, margin_m: float = MARGIN_M) -> ZonedGrid:
    grid = with_zones(FLOOR, zones, margin_m, BODY_M)
    assert isinstance(grid, ZonedGrid)
    return grid


def along(*places: tuple[float, float]) -> np.ndarray:
    """Places on straight legs from each to the next."""
    legs = zip(np.array(places), np.array(places[1:]))
    return np.concatenate([a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a) for a, b in legs])
