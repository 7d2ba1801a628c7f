"""A ground map of two rooms with a door between."""

import numpy as np

from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid


def two_rooms() -> OccupancyGrid:
    """Side by side, each 3.9 m square; the door is 0.9 m wide."""
    data = np.full((80, 160), OCCUPIED, np.int8)
    data[1:-1, 1:79] = data[1:-1, 81:-1] = FREE
    data[30:48, 79:81] = FREE
    return OccupancyGrid(data, 0.05, -1.0, -2.0)
