"""The ground of an emulated world: the truth as a grid, and where a robot fits: free space, passages and a start."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.sim.emulated_world import EmulatedWorld, W
from vsx_ros.sim.mesh_world import SLICE_M, MeshWorld
from vsx_ros.sim.world import Start

MARGIN_CELLS = 6  # around the world
SUBPIXEL_BITS = 8  # OpenCV's fixed point
PASSAGE_RADIUS_M = 0.25  # of the base and what it keeps clear
START_AHEAD_M = 1.2  # free ahead of the start, for the drive that starts the map
START_GAP_M = 0.5  # free around it
START_TRIES = 120  # places drawn
BAND_M = 0.6  # height of what the base can touch
ROOM_M2 = 1.0  # for the robot's centre; less is a pocket between things
ROBOT_RADIUS_M, TOUCHING_M = 0.18, 0.15  # for the check of a start; where a run may have ended, at something
_SOLID = "a wall or a thing"  # of a building, where things have no names


def _solid_grid(world: EmulatedWorld, resolution: float, z_min: float, z_max: float) -> OccupancyGrid:
    """Every cell OCCUPIED where something is solid or there is no ground, otherwise FREE."""
    x0, y0, x1, y1 = world.bounds
    columns = int(np.ceil((x1 - x0) / resolution)) + 2 * MARGIN_CELLS
    rows = int(np.ceil((y1 - y0) / resolution)) + 2 * MARGIN_CELLS
    origin_x, origin_y = x0 - MARGIN_CELLS * resolution, y0 - MARGIN_CELLS * resolution
    solid = np.ones((rows, columns), np.uint8)
    for polygon, is_solid in world.plan(z_min, z_max):
        fill(solid, (polygon - np.array([origin_x, origin_y])) / resolution, int(is_solid))
    return OccupancyGrid(np.where(solid, OCCUPIED, FREE).astype(np.int8), resolution, origin_x, origin_y)


def fill(mask: NDArray[np.uint8] | NDArray[np.int32], polygon: Points2, value: int) -> None:
    """Draw a polygon (N, 2), in cells from the mask's corner, into a mask (H, W); in place."""
    corners = (polygon - 0.5) * (1 << SUBPIXEL_BITS)
    cv2.fillPoly(mask, [np.rint(corners).astype(np.int32)], value, cv2.LINE_8, SUBPIXEL_BITS)


def ground_truth_grid(world: EmulatedWorld, resolution: float, z_min: float, z_max: float) -> OccupancyGrid:
    """What is solid between the heights [m]; resolution in metres per cell. Free: connected with the start. Occupied:
    solid within two cells of free space. Unknown: inside solids and outside the building."""
    grid = _solid_grid(world, resolution, z_min, z_max)
    solid = (grid.data == OCCUPIED).astype(np.uint8)
    _, labels = cv2.connectedComponents(1 - solid, connectivity=4)
    row, column = grid.cells(np.array([[world.start.x, world.start.y]]))[0]
    inside = (labels == labels[row, column]) & (solid == 0)
    near = cv2.dilate(inside.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    data = np.full(grid.shape, UNKNOWN, np.int8)
    data[near & (solid == 1)] = OCCUPIED
    data[inside] = FREE
    return OccupancyGrid(data, resolution, grid.origin_x, grid.origin_y)


def _fits(world: EmulatedWorld) -> tuple[BoolArray, OccupancyGrid]:
    """Cells of the grid where the centre of a robot of radius 0.25 m fits, and the grid."""
    grid = ground_truth_grid(world, 0.05, 0.0, BAND_M)
    room = (grid.data == FREE).astype(np.uint8)
    fits: BoolArray = cv2.distanceTransform(room, cv2.DIST_L2, 5) * grid.resolution > PASSAGE_RADIUS_M + 0.05
    return fits, grid


def reachable_area_m2(world: EmulatedWorld, radius_m: float) -> float:
    """Area [m2] that the centre of a disc can reach from the start; 0 if it does not fit there."""
    grid = ground_truth_grid(world, 0.05, 0.0, BAND_M)
    space = cv2.distanceTransform((grid.data == FREE).astype(np.uint8), cv2.DIST_L2, 5) * grid.resolution
    _, labels = cv2.connectedComponents((space > radius_m).astype(np.uint8), connectivity=4)
    row, column = grid.cells(np.array([[world.start.x, world.start.y]]))[0]
    label = int(labels[row, column])
    return float((labels == label).sum()) * grid.resolution**2 if label else 0.0


def free_places(world: EmulatedWorld) -> Points2:
    """(N, 2) places where the centre of a robot of radius 0.25 m fits [m], 5 cm apart."""
    fits, grid = _fits(world)
    return grid.centres(np.argwhere(fits))


def is_connected(world: EmulatedWorld) -> bool:
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


def free_ahead(world: EmulatedWorld, x: float, y: float, theta: float) -> float:
    """How far a disc of radius 0.25 m can go straight ahead from a pose before it touches something [m], at most 6."""
    steps = np.arange(0.0, 6.0, 0.05)
    points = np.array([x, y]) + steps[:, None] * np.array([math.cos(theta), math.sin(theta)])
    low, high = points.min(axis=0) - PASSAGE_RADIUS_M, points.max(axis=0) + PASSAGE_RADIUS_M
    segments = world.obstacle_segments(0.0, BAND_M)
    a, b = segments[:, :2], segments[:, 2:]
    beside = segments[(np.maximum(a, b) >= low).all(axis=1) & (np.minimum(a, b) <= high).all(axis=1)]
    if not len(beside):
        return 6.0
    blocked = gap_to_walls(beside, points) < PASSAGE_RADIUS_M
    return float(steps[np.argmax(blocked)]) if blocked.any() else 6.0


def with_start(rng: np.random.Generator, world: W) -> W:
    """Put the start where 1.2 m ahead are free, with posters or printed boxes in view. Raises ConfigError for a world
    without a place for the robot."""
    places = free_places(world)
    if not len(places):
        raise ConfigError(f"world {world.name} has no place where the robot fits; make its passages wider")
    segments = world.obstacle_segments(0.0, BAND_M)
    best, best_score = world.start, -1.0
    for _ in range(START_TRIES):
        x, y = places[int(rng.integers(len(places)))].tolist()
        theta = float(rng.uniform(-math.pi, math.pi))
        if gap_to_walls(segments, np.array([[x, y]]))[0] < START_GAP_M:
            continue
        ahead = free_ahead(world, x, y, theta)
        if ahead < START_AHEAD_M + 0.3:
            continue
        angles = [math.atan2(sy - y, sx - x) - theta for sx, sy in world.sights]
        distances = [math.hypot(sx - x, sy - y) for sx, sy in world.sights]
        seen = sum(1.0 for a, d in zip(angles, distances) if math.cos(a) > 0.92 and 1.0 < d < 5.0)
        score = min(seen, 5.0) + 0.5 * min(ahead, 3.0)
        if score > best_score:
            best, best_score = Start(x=x, y=y, theta_rad=theta), score
    return world.starting_at(best)


def checked_start(world: W, name: str, radius_m: float = ROBOT_RADIUS_M) -> W:
    """The world unchanged; name: what messages call it. Raises ConfigError if a robot of radius_m [m] does not fit at
    its start, or has no floor there."""
    x, y = world.start.x, world.start.y
    x0, y0, x1, y1 = world.bounds
    if not (x0 <= x <= x1 and y0 <= y <= y1):
        outlines = f"its outlines, ({x0:.1f}, {y0:.1f}) to ({x1:.1f}, {y1:.1f}) m"
        raise ConfigError(f"world {name}: it starts at {x:g}, {y:g}, outside of {outlines}; give a place in it")
    around = world.owner_around(x, y) if isinstance(world, MeshWorld) else _solid_around(world, x, y)
    if around is not None or gap_to_walls(world.obstacle_segments(0.0, SLICE_M[1]), np.array([[x, y]]))[0] < radius_m:
        owner = around or (world.owner_near(x, y) if isinstance(world, MeshWorld) else _SOLID)
        raise ConfigError(f"world {name}: a robot at {x:g}, {y:g} stands in {owner}; choose another start")
    if isinstance(world, MeshWorld) and ground_truth_grid(world, 0.05, *SLICE_M).value_at(x, y) != FREE:
        raise ConfigError(f"world {name}: there is no floor at {x:g}, {y:g}; choose another start")
    return world


def _solid_around(world: EmulatedWorld, x: float, y: float) -> str | None:
    """What is solid at a place of a building, or None."""
    inside = [solid for corners, solid in world.plan(*SLICE_M) if _holds(corners, x, y)]
    return None if inside and not inside[-1] else _SOLID


def _holds(polygon: Points2, x: float, y: float) -> bool:
    return cv2.pointPolygonTest((polygon - [x, y]).astype(np.float32), (0.0, 0.0), False) >= 0.0


def middle_of_largest_room(world: MeshWorld) -> Start:
    """The place with the most space around it, on the largest ground that a robot can drive, looking to where most is
    free. Ground outside, which reaches the end of the world, and the hollow inside of solids are rooms only if there is
    no other. Raises ConfigError for a world without a place for the robot."""
    grid = _solid_grid(world, 0.05, 0.0, BAND_M)
    space = cv2.distanceTransform((grid.data == FREE).astype(np.uint8), cv2.DIST_L2, 5) * grid.resolution
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((space > PASSAGE_RADIUS_M).astype(np.uint8))
    if count < 2:
        raise ConfigError(f"world {world.name} has no place where the robot fits; make its passages wider")
    outside = np.zeros(count, bool)
    outside[np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])] = True
    areas = statistics[:, cv2.CC_STAT_AREA] * grid.resolution**2
    by_area = [label for label in np.argsort(-areas, kind="stable").tolist() if label > 0]
    rooms = [label for label in by_area if not outside[label] and areas[label] >= ROOM_M2]
    middles = (_middle(grid, np.where(labels == label, space, 0.0)) for label in [*rooms, *by_area])
    empty = next((middle for middle in middles if world.owner_around(*middle) is None), None)
    x, y = empty or _middle(grid, space)
    headings = np.arange(16) * (math.pi / 8.0)
    ahead = [free_ahead(world, x, y, float(heading)) for heading in headings]
    return Start(x=x, y=y, theta_rad=float(headings[int(np.argmax(ahead))]))


def _middle(grid: OccupancyGrid, space: FloatArray) -> tuple[float, float]:
    """The place [m] of the cell with the most space around it."""
    row, column = np.unravel_index(int(np.argmax(space)), space.shape)
    x, y = grid.centres(np.array([[row, column]]))[0].tolist()
    return x, y
