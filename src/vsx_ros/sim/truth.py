"""The ground of an emulated world: the truth as a grid, and where a robot fits: free space, passages and a start."""

import math

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2
from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.sim.world import Start, World, obstacle_segments, prisms

MARGIN_CELLS = 6  # around the world
SUBPIXEL_BITS = 8  # OpenCV's fixed point
PASSAGE_RADIUS_M = 0.25  # of the base and what it keeps clear
START_AHEAD_M = 1.2  # free ahead of the start, for the drive that starts the map
START_GAP_M = 0.5  # free around it
START_TRIES = 120  # places drawn
BAND_M = 0.6  # height of what the base can touch
DOOR_M = 1.65  # a wider gap between two walls in line is no door


def ground_truth_grid(world: World, resolution: float, z_min: float, z_max: float) -> OccupancyGrid:
    """What is solid between the heights [m]; resolution in metres per cell. Free: connected with the start. Occupied:
    solid within two cells of free space. Unknown: inside solids and outside the building."""
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


def room_truth(world: World, grid: OccupancyGrid) -> IntArray:
    """(H, W) the true rooms on the cells of a grid in the world's frame, numbered from 1; 0 in walls and outside. Doors
    are gaps between free-standing walls in line along an axis; furniture counts as ground."""
    solid = np.ones(grid.shape, np.uint8)
    for outline in world.outlines:
        _fill(solid, grid, np.asarray(outline.points, float), 0 if signed_area(np.asarray(outline.points)) > 0 else 1)
    half = 0.5 * grid.resolution
    for a, b, thickness in _walls_with_doors_shut(world):
        low, high = np.minimum(a, b) - 0.5 * thickness - half, np.maximum(a, b) + 0.5 * thickness + half
        _fill(solid, grid, np.array([low, [high[0], low[1]], high, [low[0], high[1]]]), 1)
    return np.asarray(cv2.connectedComponents(1 - solid, connectivity=4)[1], np.int64)


def _walls_with_doors_shut(world: World) -> list[tuple[Points2, Points2, float]]:
    """Ends and thickness of each wall, and of what would shut each door."""
    walls = [(np.array(w.points[0]), np.array(w.points[-1]), w.thickness) for w in world.walls]
    shut = []
    for axis in (0, 1):
        along = [wall for wall in walls if abs(wall[0][1 - axis] - wall[1][1 - axis]) < 1e-9]
        for a, b, thickness in along:
            end = a if a[axis] > b[axis] else b
            starts = [c if c[axis] < d[axis] else d for c, d, _ in along if abs(c[1 - axis] - a[1 - axis]) < 1e-9]
            gaps = [(start[axis] - end[axis], start) for start in starts if 0.0 < start[axis] - end[axis] <= DOOR_M]
            shut += [(end, min(gaps, key=lambda gap: gap[0])[1], thickness)] if gaps else []
    return walls + shut


def _fill(mask: NDArray[np.uint8], grid: OccupancyGrid, polygon: Points2, value: int) -> None:
    """Draw a polygon [m] into a mask over the cells of a grid."""
    corners = (polygon - [grid.origin_x, grid.origin_y]) / grid.resolution - 0.5
    cv2.fillPoly(mask, [np.rint(corners * (1 << SUBPIXEL_BITS)).astype(np.int32)], value, cv2.LINE_8, SUBPIXEL_BITS)


def signed_area(loop: Points2) -> float:
    """The area of a polygon (N, 2) [m2], positive if it runs counter-clockwise."""
    x, y = loop[:, 0], loop[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _fits(world: World) -> tuple[BoolArray, OccupancyGrid]:
    """Cells of the grid where the centre of a robot of radius 0.25 m fits, and the grid."""
    grid = ground_truth_grid(world, 0.05, 0.0, BAND_M)
    room = (grid.data == FREE).astype(np.uint8)
    fits: BoolArray = cv2.distanceTransform(room, cv2.DIST_L2, 5) * grid.resolution > PASSAGE_RADIUS_M + 0.05
    return fits, grid


def free_places(world: World) -> Points2:
    """(N, 2) places where the centre of a robot of radius 0.25 m fits [m], 5 cm apart."""
    fits, grid = _fits(world)
    return grid.centres(np.argwhere(fits))


def is_connected(world: World) -> bool:
    """Whether a robot of radius 0.25 m can reach every place it fits into, except pockets under 0.1 m2."""
    fits, grid = _fits(world)
    count, _, statistics, _ = cv2.connectedComponentsWithStats(fits.astype(np.uint8), connectivity=4)
    areas = np.sort(statistics[1:, cv2.CC_STAT_AREA]) * grid.resolution**2
    return count >= 2 and (count == 2 or float(areas[-2]) < 0.1)


def gap_to_walls(segments: FloatArray, points: Points2) -> FloatArray:
    """(N,) distance [m] from points (N, 2) to the nearest of the segments (M, 4)."""
    a, edge = segments[:, :2], segments[:, 2:] - segments[:, :2]
    offset = points[:, None, :] - a
    ratio = np.clip((offset * edge).sum(axis=2) / np.maximum((edge**2).sum(axis=1), 1e-12), 0.0, 1.0)
    gap = offset - ratio[..., None] * edge
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]).min(axis=1), np.float64)


def free_ahead(world: World, x: float, y: float, theta: float) -> float:
    """How far a disc of radius 0.25 m can go straight ahead from a pose before it touches something [m], at most 6."""
    steps = np.arange(0.0, 6.0, 0.05)
    points = np.array([x, y]) + steps[:, None] * np.array([math.cos(theta), math.sin(theta)])
    blocked = gap_to_walls(obstacle_segments(world, 0.0, BAND_M), points) < PASSAGE_RADIUS_M
    return float(steps[np.argmax(blocked)]) if blocked.any() else 6.0


def with_start(rng: np.random.Generator, world: World) -> World:
    """Put the start where 1.2 m ahead are free, with posters or printed boxes in view. Raises ConfigError for a world
    without a place for the robot."""
    places = free_places(world)
    if not len(places):
        raise ConfigError(f"world {world.generator.name} has no place where the robot fits; make its passages wider")
    sights = [(p.x, p.y) for p in world.posters] + [(b.x, b.y) for b in world.boxes if b.material.startswith("print")]
    segments = obstacle_segments(world, 0.0, BAND_M)
    best, best_score = world.start, -1.0
    for _ in range(START_TRIES):
        x, y = places[int(rng.integers(len(places)))].tolist()
        theta = float(rng.uniform(-math.pi, math.pi))
        ahead = free_ahead(world, x, y, theta)
        if ahead < START_AHEAD_M + 0.3 or gap_to_walls(segments, np.array([[x, y]]))[0] < START_GAP_M:
            continue
        angles = [math.atan2(sy - y, sx - x) - theta for sx, sy in sights]
        distances = [math.hypot(sx - x, sy - y) for sx, sy in sights]
        seen = sum(1.0 for a, d in zip(angles, distances) if math.cos(a) > 0.92 and 1.0 < d < 5.0)
        score = min(seen, 5.0) + 0.5 * min(ahead, 3.0)
        if score > best_score:
            best, best_score = Start(x=x, y=y, theta_rad=theta), score
    return replace(world, start=best)
