"""Stretches of a path that are driven slowly: where the map is out of view, and in slow zones."""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zoned_grid import speed_limits
from vsx_ros.planning.path import Path

_STEP_M = 0.05  # a cell


def blind_spans(spans: FloatArray | None, v_m_s: float) -> FloatArray:
    """(K, 3) first and last arc length [m] and speed [m/s], of the ``Plan.blind_spans``."""
    spans = np.zeros((0, 2)) if spans is None else spans
    return np.column_stack([spans, np.full(len(spans), v_m_s)])


def zone_spans(path: Path, grid: OccupancyGrid | None, T_map_frame: SE2 | None) -> FloatArray:
    """(K, 3) likewise, in slow zones. T_map_frame: the path's frame in the map; None if that is not known."""
    if grid is None or T_map_frame is None:
        return np.zeros((0, 3))
    rows = path.sample(_STEP_M)
    limits = speed_limits(grid, T_map_frame @ rows[:, :2])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
    spans = [(a, b, min(v, w)) for a, b, v, w in zip(s[:-1], s[1:], limits[:-1], limits[1:]) if min(v, w) < np.inf]
    return np.array(spans, float).reshape(-1, 3)
