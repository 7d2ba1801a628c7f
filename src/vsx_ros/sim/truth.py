"""The ground truth of an emulated world as a grid."""

import cv2
import numpy as np

from vsx_ros.arrays import Points2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.sim.world import World, prisms

MARGIN_CELLS = 6
SUBPIXEL_BITS = 8


def ground_truth_grid(world: World, resolution: float, z_min: float, z_max: float) -> OccupancyGrid:
    """What is solid between the heights [m]; resolution in metres per cell.

    Free: reachable on foot from the start. Occupied: solid within two cells of free space. Unknown: inside solids and
    outside the building.
    """
    x0, y0, x1, y1 = world.bounds
    columns = int(np.ceil((x1 - x0) / resolution)) + 2 * MARGIN_CELLS
    rows = int(np.ceil((y1 - y0) / resolution)) + 2 * MARGIN_CELLS
    origin_x, origin_y = x0 - MARGIN_CELLS * resolution, y0 - MARGIN_CELLS * resolution
    solid = np.ones((rows, columns), np.uint8)

    def fill(polygon: Points2, value: int) -> None:
        pixels = ((polygon - np.array([origin_x, origin_y])) / resolution - 0.5) * (1 << SUBPIXEL_BITS)
        cv2.fillPoly(solid, [np.rint(pixels).astype(np.int32)], value, cv2.LINE_8, SUBPIXEL_BITS)

    loops = [np.asarray(outline.points, float) for outline in world.outlines]
    for loop in sorted(loops, key=signed_area, reverse=True):
        fill(loop, 0 if signed_area(loop) > 0 else 1)
    for prism in prisms(world):
        if prism.z_min < z_max and prism.z_max > z_min:
            fill(prism.footprint, 1)
    _, labels = cv2.connectedComponents(1 - solid, connectivity=4)
    grid = OccupancyGrid(np.where(solid, OCCUPIED, FREE).astype(np.int8), resolution, origin_x, origin_y)
    row, column = grid.cells(np.array([[world.start.x, world.start.y]]))[0]
    inside = (labels == labels[row, column]) & (solid == 0)
    near = cv2.dilate(inside.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    data = np.full((rows, columns), UNKNOWN, np.int8)
    data[near & (solid == 1)] = OCCUPIED
    data[inside] = FREE
    return OccupancyGrid(data, resolution, origin_x, origin_y)


def signed_area(loop: Points2) -> float:
    """Of a polygon (N, 2) [m2], positive where it runs counter-clockwise."""
    x, y = loop[:, 0], loop[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
