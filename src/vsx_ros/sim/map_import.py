"""Any building from its map: a map_server map extruded to walls, its surfaces drawn by seed."""

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, Points2
from vsx_ros.errors import MapFileError
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.sim.generate import shell
from vsx_ros.sim.interior import decorated
from vsx_ros.sim.truth import signed_area, with_start
from vsx_ros.sim.world import Origin, Point, World

TOLERANCE_M = 0.06  # by which outlines are simplified: about a cell
MAX_OBSTACLES, MAX_SIDES = 5000, 20_000
"""A robot's own map of a building has some hundreds and some thousands."""


def world_from_grid(grid: OccupancyGrid, name: str, seed: int) -> World:
    """The largest free region of a map as a building whose surfaces are drawn by seed.

    Raises MapFileError when there is no free region of a square metre.
    """
    rng = np.random.default_rng([seed, 1000])
    corners: list[list[Point]] = [[(x, y) for x, y in loop.tolist()] for loop in free_space_outlines(grid)]
    world = shell(rng, Origin(name=name, seed=seed), corners, _open_spot(grid))
    return with_start(rng, decorated(rng, world, 1.5))


def _largest_free_region(grid: OccupancyGrid) -> BoolArray:
    """(H, W) Raises MapFileError when there is none of a square metre."""
    free = (grid.data == FREE).astype(np.uint8)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    areas = statistics[1:, cv2.CC_STAT_AREA] * grid.resolution**2
    if count < 2 or float(areas.max()) < 1.0:
        raise MapFileError("the map has no free region of at least 1 m2; are its thresholds wrong?")
    largest: BoolArray = labels == 1 + int(np.argmax(areas))
    return largest


def _open_spot(grid: OccupancyGrid) -> Point:
    """The place farthest from any obstacle."""
    free = np.pad(_largest_free_region(grid), 1).astype(np.uint8)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)[1:-1, 1:-1]
    x, y = grid.centres(np.array(np.unravel_index(int(np.argmax(distance)), distance.shape)))[0].tolist()
    return x, y


def free_space_outlines(grid: OccupancyGrid) -> list[Points2]:
    """Borders of the largest free region as closed polygons [m], free space to the left, simplified by 6 cm.

    Raises MapFileError when there is no free region of a square metre, or its borders are too many.
    """
    region = _largest_free_region(grid).astype(np.uint8)
    pieces = cv2.connectedComponents(np.pad(1 - region, 1, constant_values=1), connectivity=8)[0] - 2
    if pieces > MAX_OBSTACLES:
        raise MapFileError(
            f"the map has {pieces} separate obstacles, at most {MAX_OBSTACLES} can be built; clean the picture"
        )
    contours, tree = cv2.findContours(region, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outlines = []
    for contour, links in zip(contours, tree[0]):
        simple = cv2.approxPolyDP(contour, TOLERANCE_M / grid.resolution, True).reshape(-1, 2).astype(float)
        if len(simple) < 3:
            continue
        points = (simple + 0.5) * grid.resolution + np.array([grid.origin_x, grid.origin_y])
        is_hole = links[3] >= 0
        outlines.append(points[::-1] if (signed_area(points) > 0) == is_hole else points)
    sides = sum(len(outline) for outline in outlines)
    if sides > MAX_SIDES:
        raise MapFileError(f"the map's borders have {sides} sides, at most {MAX_SIDES} can be built; smooth it")
    return outlines
