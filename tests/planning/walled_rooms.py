"""Free rooms with walls, 5 cm cells, for questions to the planners."""

import numpy as np

from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid


def room(columns: int = 121, rows: int = 83) -> np.ndarray:
    """A free room of odd size."""
    data = np.full((rows, columns), FREE, np.int8)
    data[:2] = data[-2:] = OCCUPIED
    data[:, :2] = data[:, -2:] = OCCUPIED
    return data


def grid(data: np.ndarray) -> OccupancyGrid:
    """The map of such a room."""
    return OccupancyGrid(data, 0.05, -1.0, -1.0)


def with_wall(gap: slice) -> OccupancyGrid:
    """The room divided by a wall with a gap."""
    data = room()
    data[:, 58:61] = OCCUPIED
    data[gap, 58:61] = FREE
    return grid(data)
