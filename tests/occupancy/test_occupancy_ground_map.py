"""A box room with known truth, seen by keyframes on a loop, with noise, outliers and floor points."""

import numpy as np
import pytest

from vsx_ros.config import GroundMapConfig, RobotConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.occupancy.unknown_ground import gaps

MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.0)
ROOM = (-3.0, 3.0, -2.0, 2.0)
BOX = (0.9, 1.5, -0.4, 0.4)
HALF_FOV = np.deg2rad(31)


def segment_blocked(a, b, rect):
    """(N,) whether the segments from a (2,) to b (N, 2) pass through the interior of the rectangle."""
    x0, x1, y0, y1 = rect
    t = np.linspace(0.0, 0.995, 200)[:, None, None]
    points = a + t * (b - a)
    inside = (points[..., 0] > x0) & (points[..., 0] < x1) & (points[..., 1] > y0) & (points[..., 1] < y1)
    return inside.any(axis=0)


def wall_points(rng, n, rect, heights):
    x0, x1, y0, y1 = rect
    s, side = rng.uniform(0, 1, n), rng.integers(0, 4, n)
    x = np.select([side == 0, side == 1], [x0, x1], x0 + s * (x1 - x0))
    y = np.select([side == 2, side == 3], [y0, y1], y0 + s * (y1 - y0))
    return np.column_stack([x, y, rng.uniform(*heights, n)])


@pytest.fixture(scope="module")
def room():
    """Keyframes, points and observations of a robot that drives a loop around the box."""
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(-3, 3, 800), rng.uniform(-2, 2, 800), np.zeros(800)])
    in_box = (floor[:, 0] > 0.9) & (floor[:, 0] < 1.5) & (np.abs(floor[:, 1]) < 0.4)
    points = np.vstack([
        wall_points(rng, 1500, ROOM, (0.0, 1.2)), wall_points(rng, 400, BOX, (0.05, 0.5)), floor[~in_box]
    ])  # fmt: skip
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    trail = [SE2(1.9 * np.cos(a), 1.2 * np.sin(a), np.arctan2(1.2 * np.cos(a), -1.9 * np.sin(a))) for a in angles]
    inward = [SE2(pose.x, pose.y, pose.theta + 0.9) for pose in trail]
    poses = [SE3.from_se2(pose) @ MOUNT for pose in (*trail, *inward)]
    keyframe, point = [], []
    for k, T in enumerate(poses):
        p = T.inverse() @ points
        bearing = np.abs(np.arctan2(p[:, 0], p[:, 2]))
        elevation = np.abs(p[:, 1]) < 0.45 * p[:, 2]
        seen = (
            (p[:, 2] > 0.3) & (bearing < HALF_FOV) & elevation & ~segment_blocked(T.translation[:2], points[:, :2], BOX)
        )
        keyframe.append(np.full(seen.sum(), k))
        point.append(np.flatnonzero(seen))
    noisy = points + rng.normal(0, 0.008, points.shape)
    return poses, noisy, np.concatenate(keyframe), np.concatenate(point), DriveHistory(trail)


@pytest.fixture(scope="module")
def ground_map():
    return GroundMap(GroundMapConfig(), RobotConfig())


def centres_of(grid, value):
    return grid.centres(np.argwhere(grid.data == value))


def distance_to_walls(xy):
    def outline(rect):
        x0, x1, y0, y1 = rect
        dx = np.maximum(np.maximum(x0 - xy[:, 0], xy[:, 0] - x1), 0)
        dy = np.maximum(np.maximum(y0 - xy[:, 1], xy[:, 1] - y1), 0)
        inner = np.minimum.reduce([xy[:, 0] - x0, x1 - xy[:, 0], xy[:, 1] - y0, y1 - xy[:, 1]])
        return np.where(inner > 0, inner, np.hypot(dx, dy))

    return np.minimum(outline(ROOM), outline(BOX))


def share_of_floor_called_free(grid):
    x, y = np.meshgrid(np.arange(-2.85, 2.9, 0.05), np.arange(-1.85, 1.9, 0.05))
    xy = np.column_stack([x.ravel(), y.ravel()])
    outside_box = ~((xy[:, 0] > 0.8) & (xy[:, 0] < 1.6) & (np.abs(xy[:, 1]) < 0.5))
    return np.mean([grid.value_at(*p) == FREE for p in xy[outside_box]])


def test_the_room_is_mapped(room, ground_map):
    grid = ground_map.build(*room)
    assert np.mean(distance_to_walls(centres_of(grid, OCCUPIED)) < 0.10) > 0.99
    assert share_of_floor_called_free(grid) > 0.97
    free = centres_of(grid, FREE)
    in_box = (free[:, 0] > 1.0) & (free[:, 0] < 1.4) & (np.abs(free[:, 1]) < 0.3)
    outside = (np.abs(free[:, 0]) > 3.1) | (np.abs(free[:, 1]) > 2.1)
    assert in_box.mean() < 0.001
    assert outside.mean() < 0.001
    assert grid.value_at(1.2, 0.0) == UNKNOWN


def test_most_of_the_wall_is_there(room, ground_map):
    grid = ground_map.build(*room)
    x = np.arange(-2.9, 2.9, 0.05)
    wall = np.vstack([np.column_stack([x, np.full_like(x, 2.0)]), np.column_stack([x, np.full_like(x, -2.0)])])
    occupied = centres_of(grid, OCCUPIED)
    nearest = np.min(np.linalg.norm(wall[:, None] - occupied[None], axis=2), axis=1)
    assert np.mean(nearest < 0.1) > 0.85


def test_the_same_input_gives_the_same_grid(room, ground_map):
    assert np.array_equal(ground_map.build(*room).data, ground_map.build(*room).data)


def test_outliers_in_free_space_do_not_stay(room, ground_map):
    poses, points, keyframe, point, driven = room
    rng = np.random.default_rng(3)
    outliers = np.column_stack([rng.uniform(-2.5, 0.6, 40), rng.uniform(-1.6, 1.6, 40), rng.uniform(0.1, 0.6, 40)])
    seen = [np.argsort([np.linalg.norm(T.translation - p) for T in poses])[3:5] for p in outliers]
    keyframe = np.concatenate([keyframe, np.concatenate(seen)])
    point = np.concatenate([point, np.repeat(np.arange(len(points), len(points) + 40), 2)])
    grid = ground_map.build(poses, np.vstack([points, outliers]), keyframe, point, driven)
    assert np.mean(distance_to_walls(centres_of(grid, OCCUPIED)) < 0.10) > 0.97


def test_floor_points_never_become_obstacles(room, ground_map):
    poses, points, keyframe, point, _ = room
    floor = np.flatnonzero(points[:, 2] < 0.05)
    tilted = points.copy()
    tilted[floor, 2] += 0.02
    chosen = np.isin(point, floor)
    grid = ground_map.build(poses, tilted, keyframe[chosen], point[chosen])
    assert not (grid.data == OCCUPIED).any()
    assert (grid.data == FREE).sum() > 3000


def one_view(points, config=None, n=3, step=0.15, level=None):
    """A grid from n keyframes that look along x and see all points, on one pyramid level."""
    poses = [SE3.from_se2(SE2(-step * i, 0.1 * (i % 2), 0.0)) @ MOUNT for i in range(n)]
    points = np.array(points, float)
    keyframe, point = np.repeat(np.arange(n), len(points)), np.tile(np.arange(len(points)), n)
    levels = None if level is None else np.full(len(point), level)
    return GroundMap(config or GroundMapConfig(), RobotConfig()).build(poses, points, keyframe, point, obs_level=levels)


def abreast(x, z, half_width=0.4):
    """Points across the x axis, close enough for their rays to leave no gap."""
    return [[x, y, z] for y in np.linspace(-half_width, half_width, 40)]


def test_a_ray_to_a_high_point_clears_only_while_it_is_low():
    grid = one_view(abreast(3.0, 1.4, 2.0))
    assert grid.value_at(0.1, 0.0) == FREE
    assert grid.value_at(0.8, 0.0) == UNKNOWN
    assert grid.value_at(3.0, 0.0) == UNKNOWN


def test_a_wall_point_in_the_band_stops_the_ray_behind_it():
    grid = one_view([*abreast(1.5, 0.3, 0.1), *abreast(3.0, 0.31)])
    assert grid.value_at(1.0, 0.0) == FREE
    assert grid.value_at(1.5, 0.0) == OCCUPIED
    assert grid.value_at(2.2, 0.0) == UNKNOWN


def test_free_ground_that_few_saw_ends_a_cell_before_what_nobody_saw(ground_map):
    """The same three views once, and as if four keyframes stood at each."""
    points = np.array([[3.0, y, 0.02] for y in np.linspace(-0.5, 0.5, 80)])
    poses = [SE3.from_se2(SE2(-0.15 * i, 0.1 * (i % 2), 0.0)) @ MOUNT for i in range(3)]

    def half_widths(times):
        keyframe, point = np.repeat(np.arange(3 * times), 80), np.tile(np.arange(80), 3 * times)
        grid = ground_map.build(poses * times, points, keyframe, point)
        y = np.arange(0.01, 0.6, 0.05)
        return np.array([sum(grid.value_at(x, b) == FREE for b in y) for x in np.arange(1.2, 2.2, 0.1)])

    few, more = half_widths(1), half_widths(4)
    assert (few >= 1).all()
    assert (more >= few).all()
    assert (more > few).mean() > 0.6


def test_a_ray_over_a_box_frees_nothing_behind_its_edge():
    """A box of 0.42 m hides all that is low behind it; points high on the wall behind are seen above it."""
    above = [[3.0, y, 0.31 + 3.3 * (0.42 - 0.31) / 1.3] for y in np.linspace(-0.4, 0.4, 60)]
    grid = one_view(above, n=2)
    assert grid.value_at(1.1, 0.0) != FREE
    assert grid.value_at(0.4, 0.0) == FREE


def test_coarse_corners_end_rays_but_are_no_obstacle():
    wall = abreast(1.5, 0.3, 0.1)
    assert (one_view(wall, level=2).data == OCCUPIED).any()
    coarse = one_view([*wall, *abreast(3.0, 0.31)], level=3)
    assert not (coarse.data == OCCUPIED).any()
    assert coarse.value_at(1.0, 0.0) == FREE
    assert coarse.value_at(2.2, 0.0) == UNKNOWN


def test_a_table_top_above_the_robot_is_no_obstacle():
    assert not (one_view([[1.5, 0.0, 0.74], [1.5, 0.04, 0.74]]).data == OCCUPIED).any()


def test_reflections_below_the_floor_say_nothing():
    grid = one_view([[2.0, 0.0, -0.5]])
    assert not (grid.data != UNKNOWN).any()


def test_a_point_of_uncertain_depth_is_no_obstacle():
    assert not (one_view([[4.0, 0.0, 0.3], [4.0, 0.04, 0.3]], step=0.002).data == OCCUPIED).any()


def test_small_holes_between_free_cells_are_closed():
    grid = one_view([[3.0, y, 0.02] for y in np.arange(-0.5, 0.5, 0.11)])
    between = [grid.value_at(2.3, y) for y in np.arange(-0.35, 0.3, 0.05)]
    assert between.count(UNKNOWN) == 0


def test_a_gap_in_ground_that_hardly_anybody_saw_stays():
    """It may be the leg of a table, with its shadow."""
    data = np.full((20, 20), FREE, np.int8)
    data[5, 5] = data[12:19, 12] = UNKNOWN
    sure = np.ones(data.shape, bool)
    assert gaps(data, sure).sum() == 8
    sure[:, 4:] = False
    assert not gaps(data, sure).any()


def test_the_trail_is_free_and_bumps_stay_whatever_is_seen(room, ground_map):
    poses, points, keyframe, point, driven = room
    bump = SE2(-1.0, 0.0, 0.0)
    bumped = DriveHistory([*driven.trail, bump, SE2(-0.7, 0.0, 0.0)], [bump])
    grid = ground_map.build(poses, points, keyframe, point, bumped)
    assert all(grid.value_at(p.x + 0.1, p.y) == FREE for p in driven.trail)
    assert grid.value_at(-1.0 + 0.23, 0.0) == OCCUPIED
    assert grid.value_at(-1.0, 0.0) == FREE
    arc = centres_of(grid, OCCUPIED)
    arc = arc[np.linalg.norm(arc - [-1.0, 0.0], axis=1) < 0.35]
    assert 6 <= len(arc) <= 16


def test_the_promised_strip_is_free_until_an_obstacle_is_seen(ground_map):
    none = np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int)
    start = SE2(1.0, 1.0, np.pi / 2)
    grid = ground_map.build([], *none, DriveHistory(start=start))
    assert grid.value_at(1.0, 1.65) == FREE
    assert grid.value_at(1.15, 1.3) == FREE
    assert grid.value_at(1.0, 1.8) == UNKNOWN
    assert grid.value_at(1.6, 1.0) == UNKNOWN
    poses = [SE3.from_se2(SE2(1.0 + 0.1 * i, 0.8, np.pi / 2)) @ MOUNT for i in range(3)]
    points = np.array([[1.0, 1.5, 0.3], [1.02, 1.5, 0.2]])
    seen = ground_map.build(poses, points, np.repeat([0, 1, 2], 2), np.tile([0, 1], 3), DriveHistory(start=start))
    assert seen.value_at(1.0, 1.51) == OCCUPIED


@pytest.mark.parametrize("heading", [0.0, 0.4, np.pi / 4])
def test_nothing_is_promised_beyond_where_the_base_was_stopped(ground_map, heading):
    """A wall face 24 cm ahead of the start, and one bump."""
    none, start = (np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int)), SE2(1.0, -0.5, heading)
    radius_m = RobotConfig().radius_m
    bump = start @ SE2(0.24 - radius_m, 0.0, 0.0)
    grid = ground_map.build([], *none, DriveHistory(bumps=[bump], start=start))
    forward = (start.inverse() @ centres_of(grid, FREE))[:, 0]
    assert not (forward > 0.24).any()
    assert len(forward) * grid.resolution**2 > 0.8 * np.pi * radius_m**2
    assert grid.value_at(bump.x, bump.y) == FREE
    back = DriveHistory(bumps=[start @ SE2(0.0, 0.0, np.pi), start @ SE2(0.0, 0.0, np.pi / 2)], start=start)
    ahead = start @ np.array([[0.65, 0.0]])
    assert ground_map.build([], *none, back).value_at(*ahead[0]) == FREE, "behind and beside it is not ahead"


@pytest.mark.parametrize("heading", [0.0, 0.4, np.pi / 4])
def test_nothing_is_promised_behind_what_is_seen(ground_map, heading):
    start = SE2(1.0, 1.0, heading)
    poses = [SE3.from_se2(start @ SE2(-0.4, 0.1 * i, 0.0)) @ MOUNT for i in range(3)]
    y = np.arange(-0.3, 0.31, 0.02)
    wall = start @ np.column_stack([np.full(2 * len(y), 0.4), np.repeat(y, 2)])
    points = np.column_stack([wall, np.tile([0.2, 0.3], len(y))])
    keyframe, point = np.repeat(np.arange(3), len(points)), np.tile(np.arange(len(points)), 3)
    grid = ground_map.build(poses, points, keyframe, point, DriveHistory(start=start))
    places = start.inverse() @ centres_of(grid, FREE)
    ahead = places[np.abs(places[:, 1]) < 0.25, 0]
    assert 0.3 < ahead.max() < 0.45


def test_nothing_known_is_a_grid_of_unknown(ground_map):
    grid = ground_map.build([], np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))
    assert (grid.data == UNKNOWN).all()
    assert grid.value_at(0.0, 0.0) == UNKNOWN


def test_grids_of_successive_builds_align(room, ground_map):
    poses, points, keyframe, point, driven = room
    early = keyframe < 20
    small = ground_map.build(poses[:20], points, keyframe[early], point[early], DriveHistory(driven.trail[:20]))
    large = ground_map.build(*room)
    for a, b in ((small.origin_x, large.origin_x), (small.origin_y, large.origin_y)):
        cells = (a - b) / 0.05
        assert abs(cells - round(cells)) < 1e-6


def test_observations_of_another_snapshot_are_refused(ground_map):
    with pytest.raises(InputError, match="point 7 of 2"):
        ground_map.build([MOUNT], np.ones((2, 3)), np.array([0]), np.array([7]))
    with pytest.raises(InputError, match="finite"):
        ground_map.build([MOUNT], np.full((2, 3), np.nan), np.array([0]), np.array([1]))
    with pytest.raises(InputError, match="2 levels for 1 observations"):
        ground_map.build([MOUNT], np.ones((2, 3)), np.array([0]), np.array([1]), obs_level=np.zeros(2, int))


def test_a_lone_point_is_no_obstacle():
    beyond = [[3.0, 0.005, 0.31], [3.0, 0.0, 0.25]]
    lone = one_view([[1.5, 0.0, 0.3], *beyond])
    assert np.all(centres_of(lone, OCCUPIED)[:, 0] > 2.9)
    pair = one_view([[1.5, 0.0, 0.3], [1.51, 0.01, 0.2], *beyond])
    assert pair.value_at(1.51, 0.0) == OCCUPIED


def test_a_lone_point_with_more_above_it_is_the_leg_of_a_table():
    leg, above, beyond = [1.5, 0.0, 0.3], [[1.51, 0.01, 0.7], [1.5, -0.01, 0.72]], abreast(3.0, 0.02, 0.2)
    assert one_view([leg, *above, *beyond]).value_at(1.5, 0.0) == OCCUPIED
    assert one_view([leg, *beyond]).value_at(1.5, 0.0) != OCCUPIED
    assert one_view([*above, *beyond]).value_at(1.5, 0.0) != OCCUPIED
    higher = [[x, y, z + 0.5] for x, y, z in above]
    assert one_view([leg, *higher, *beyond]).value_at(1.5, 0.0) != OCCUPIED


def test_a_plain_leg_shows_only_where_it_meets_the_table():
    beyond = abreast(3.0, 0.02, 0.2)

    def occupied(*heights: float) -> bool:
        return (
            one_view([[1.5 + 0.002 * k, 0.0, z] for k, z in enumerate(heights)] + beyond).value_at(1.5, 0.0) == OCCUPIED
        )

    assert occupied(0.62, 0.70, 0.74)
    assert not occupied(0.70, 0.72, 0.74)  # the edge of the table's top
    assert not occupied(0.75, 0.85, 0.95)  # a thing on the table
    assert not occupied(0.62, 0.63, 0.64)  # a shelf


def test_points_that_only_two_keyframes_see_are_no_obstacle():
    points = [[1.5, 0.0, 0.3], [1.52, 0.01, 0.25], [1.51, -0.01, 0.2]]
    assert one_view(points, n=3).value_at(1.51, 0.0) == OCCUPIED
    assert not (one_view(points, n=2).data == OCCUPIED).any()
