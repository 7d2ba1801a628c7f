"""Escape where every view is out of reach: short arcs ahead and back over free ground turn the camera."""

from __future__ import annotations

import math

import numpy as np

from vsx_ros.exploration.utility import traversable_cells
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid

SPOT_TURN = SE2(0.0, 0.0, math.pi / 4.0)
"""Where all arcs are blocked: a round body touches nothing new."""
_SAMPLES = 8


def escape_arc(
    grid: OccupancyGrid, T_map_base: SE2, radius_m: float, bend_rad_m: float, length_m: float, ahead: bool
) -> SE2 | None:
    """Where the base would be, seen from where it is, after an arc over which a body of radius_m [m] touches only known
    free ground; ahead rather than back, or the other way round, and to the left rather than to the right. None where
    all four arcs are blocked."""
    room = traversable_cells(grid, radius_m)
    way = 1.0 if ahead else -1.0
    for sign, turn in ((way, 1.0), (-way, 1.0), (way, -1.0), (-way, -1.0)):
        steps = np.linspace(0.0, length_m, _SAMPLES)[1:]
        arc = [SE2.exp(float(sign * s), 0.0, float(turn * s * bend_rad_m)) for s in steps]
        places = [T_map_base @ pose for pose in arc]
        cells = grid.cells(np.array([(place.x, place.y) for place in places]))
        if grid.contains(cells).all() and room[cells[:, 0], cells[:, 1]].all():
            return arc[-1]
    return None
