"""Where a robot fits: free space, passages and a place to start."""

import math

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import Start, World, changed, obstacle_segments

PASSAGE_RADIUS_M = 0.25
START_AHEAD_M = 1.2
START_GAP_M = 0.5
START_TRIES = 120
BAND_M = 0.6


def free_places(world: World) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Where the middle of a robot of radius 0.25 m fits (5 cm cells), and the x and y of columns and rows."""
    grid = ground_truth_grid(world, 0.05, 0.0, BAND_M)
    room = (grid.data == FREE).astype(np.uint8)
    fits = cv2.distanceTransform(room, cv2.DIST_L2, 5) * grid.resolution > PASSAGE_RADIUS_M + 0.05
    xs = grid.origin_x + (np.arange(grid.shape[1]) + 0.5) * grid.resolution
    ys = grid.origin_y + (np.arange(grid.shape[0]) + 0.5) * grid.resolution
    return np.asarray(fits, np.bool_), np.asarray(xs, np.float64), np.asarray(ys, np.float64)


def is_connected(world: World) -> bool:
    """Whether a robot of radius 0.25 m can reach every place it fits into, except pockets under 0.1 m2."""
    fits, _, _ = free_places(world)
    count, _, statistics, _ = cv2.connectedComponentsWithStats(fits.astype(np.uint8), connectivity=4)
    areas = np.sort(statistics[1:, cv2.CC_STAT_AREA]) * 0.05**2
    return count >= 2 and (count == 2 or float(areas[-2]) < 0.1)


def gap_to_walls(segments: FloatArray, points: Points2) -> FloatArray:
    """(N,) distance [m] from points (N, 2) to the nearest of the segments (M, 4)."""
    a, edge = segments[:, :2], segments[:, 2:] - segments[:, :2]
    offset = points[:, None, :] - a
    ratio = np.clip((offset * edge).sum(axis=2) / np.maximum((edge**2).sum(axis=1), 1e-12), 0.0, 1.0)
    gap = offset - ratio[..., None] * edge
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]).min(axis=1), np.float64)


def free_ahead(world: World, x: float, y: float, theta: float) -> float:
    """How far a disc of radius 0.25 m can go straight from a pose before it touches something, at most 6 m [m]."""
    steps = np.arange(0.0, 6.0, 0.05)
    points = np.array([x, y]) + steps[:, None] * np.array([math.cos(theta), math.sin(theta)])
    blocked = gap_to_walls(obstacle_segments(world, 0.0, BAND_M), points) < PASSAGE_RADIUS_M
    return float(steps[np.argmax(blocked)]) if blocked.any() else 6.0


def with_start(rng: np.random.Generator, world: World) -> World:
    """Put the start where 1.2 m ahead are free and something printed or hung is in view.

    Raises ConfigError for a world without a place for the robot.
    """
    fits, xs, ys = free_places(world)
    rows, columns = np.nonzero(fits)
    if not len(rows):
        raise ConfigError(f"world {world.generator.name} has no place where the robot fits; make its passages wider")
    sights = [(p.x, p.y) for p in world.posters] + [(b.x, b.y) for b in world.boxes if b.material.startswith("print")]
    segments = obstacle_segments(world, 0.0, BAND_M)
    best, best_score = world.start, -1.0
    for _ in range(START_TRIES):
        k = int(rng.integers(len(rows)))
        x, y = float(xs[columns[k]]), float(ys[rows[k]])
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
    return changed(world, start=best)
