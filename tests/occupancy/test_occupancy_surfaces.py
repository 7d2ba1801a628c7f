"""Surfaces end rays and fill obstacles, and never outvote those who look through them."""

import numpy as np
import pytest

from vsx_ros.config import GroundMapConfig, RobotConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.occupancy.virtual_scan import laser_scan

MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.0)
POSES = [SE2(-0.15 * i, 0.1 * (i % 2), 0.0) for i in range(8)]


def wall(x, y_from, y_to, heights=(0.1, 0.2, 0.3, 0.4), keyframe=0, sigma_m=0.01):
    """Spots every 4 cm of a wall across the x axis."""
    y = np.arange(y_from, y_to, 0.04)
    points = np.array([(x, b, h) for b in y for h in heights])
    return Surfaces(points, np.full(len(points), keyframe), np.full(len(points), sigma_m))


def built(points, surfaces=None, n=8, **more):
    """Keyframes that look along x and all see all points."""
    points = np.array(points, float).reshape(-1, 3)
    cameras = [SE3.from_se2(pose) @ MOUNT for pose in POSES[:n]]
    keyframe, point = np.repeat(np.arange(n), len(points)), np.tile(np.arange(len(points)), n)
    return GroundMap(GroundMapConfig(), RobotConfig()).build(
        cameras, points, keyframe, point, surfaces=surfaces, **more
    )


def column(grid, x, y_from=-0.5, y_to=0.5):
    return [grid.value_at(x, y) for y in np.arange(y_from, y_to, 0.05)]


def feet(*keyframes, x=1.51, heights=(0.1, 0.2, 0.3, 0.4)):
    """A wall of which each of these keyframes sees every spot."""
    return Surfaces(*map(np.concatenate, zip(*(wall(x, -0.6, 0.6, heights, keyframe) for keyframe in keyframes))))


def test_a_wall_without_points_is_occupied_all_along():
    grid = built([], wall(1.51, -0.6, 0.6))
    assert set(column(grid, 1.51)) == {OCCUPIED}


def test_who_sees_the_foot_of_a_wall_sees_the_floor_before_it():
    grid = built([], feet(*range(8)))
    assert set(column(grid, 1.1, -0.3, 0.3)) == {FREE}
    assert set(column(grid, 1.51)) == {OCCUPIED}
    assert FREE not in column(grid, 1.6)


def test_every_keyframe_that_shows_the_foot_sees_the_floor_and_the_wall_counts_once():
    once, rows = wall(1.51, -0.6, 0.6), np.flatnonzero(wall(1.51, -0.6, 0.6).points[:, 2] < 0.15)
    shown, witness = np.repeat(rows, 7), np.tile(np.arange(1, 8), len(rows))
    grid, alone = built([], once._replace(shown=shown, witness=witness)), built([], once)
    assert set(column(grid, 1.1, -0.3, 0.3)) == {FREE}
    assert (grid.data == FREE).sum() > 1.3 * (alone.data == FREE).sum()
    assert (grid.data == OCCUPIED).sum() == (alone.data == OCCUPIED).sum()
    box = [[0.8, y, 0.1] for y in np.linspace(-0.1, 0.1, 21)]
    assert FREE not in column(built(box, once._replace(shown=shown, witness=witness)), 1.1, -0.05, 0.05)


def test_who_sees_the_upper_part_of_a_wall_knows_nothing_of_the_floor():
    assert not (built([], feet(*range(8), heights=(0.2, 0.3, 0.4))).data == FREE).any()


def test_the_floor_ends_before_what_stands_between():
    box = [[0.8, y, 0.1] for y in np.linspace(-0.1, 0.1, 21)]
    grid = built(box, feet(*range(8)))
    assert FREE not in column(grid, 1.1, -0.05, 0.05)
    assert grid.value_at(1.1, 0.35) == FREE


def test_no_surface_is_the_map_without_surfaces():
    points = [[1.5, y, 0.3] for y in np.linspace(-0.4, 0.4, 9)]
    assert np.array_equal(built(points).data, built(points, Surfaces.none()).data)


def test_its_own_keyframe_does_not_see_through_it():
    beyond = [[3.0, y, 0.31] for y in np.linspace(-0.3, 0.3, 40)]
    assert built(beyond, n=2).value_at(2.2, 0.02) == FREE
    both = [np.concatenate(pair) for pair in zip(wall(1.51, -0.6, 0.6), wall(1.51, -0.6, 0.6, keyframe=1))]
    grid = built(beyond, Surfaces(*both), n=2)
    assert grid.value_at(1.0, 0.02) == FREE
    assert grid.value_at(2.2, 0.02) == UNKNOWN


def test_many_that_look_through_outvote_a_few_spots():
    beyond = [[3.0, y, 0.02] for y in np.linspace(-0.4, 0.4, 60)]
    grid = built(beyond, wall(1.51, -0.02, 0.05, heights=(0.3,)))
    assert OCCUPIED not in column(grid, 1.51)


@pytest.mark.parametrize("heights", [(0.01, 0.03, 0.05), (0.7, 0.8, 0.9)])
def test_what_the_robot_cannot_touch_is_no_obstacle(heights):
    assert not (built([], wall(1.51, -0.5, 0.5, heights=heights)).data == OCCUPIED).any()


def test_a_surface_nobody_knows_where_is_left_out():
    assert not (built([], wall(1.51, -0.5, 0.5, sigma_m=0.2)).data == OCCUPIED).any()


def test_where_the_robot_drove_is_free_and_where_it_bumped_is_not():
    driven = built(
        [], wall(0.51, -0.5, 0.5), driven=DriveHistory([SE2(x, 0.0, 0.0) for x in np.arange(0.0, 1.0, 0.05)])
    )
    assert set(column(driven, 0.51, -0.1, 0.1)) == {FREE}
    assert driven.value_at(0.51, 0.4) == OCCUPIED
    bumped = built([], wall(0.51, -0.5, 0.5), driven=DriveHistory([SE2(0.3, 0.0, 0.0)], [SE2(0.3, 0.0, 0.0)]))
    assert bumped.value_at(0.53, 0.0) == OCCUPIED


def test_surfaces_of_another_snapshot_are_refused():
    with pytest.raises(InputError, match="keyframe 9 of 8"):
        built([], wall(1.5, 0.0, 0.3, keyframe=9))
    with pytest.raises(InputError, match="finite"):
        built([], wall(np.nan, 0.0, 0.3))
    first = np.zeros(1, np.int64)
    with pytest.raises(InputError, match="keyframe 8 of 8"):
        built([], wall(1.5, 0.0, 0.3)._replace(shown=first, witness=first + 8))
    with pytest.raises(InputError, match="spot 99 of"):
        built([], wall(1.5, 0.0, 0.3)._replace(shown=first + 99, witness=first))
    with pytest.raises(InputError, match="0 witnesses for 1"):
        built([], wall(1.5, 0.0, 0.3)._replace(shown=first))


def test_a_laser_scan_of_the_map_stops_at_the_nearest_obstacle_and_turns_with_the_pose():
    grid = built([], Surfaces(*[np.concatenate(pair) for pair in zip(wall(1.51, -0.6, 0.6), wall(2.51, -2.0, 2.0))]))
    ahead = laser_scan(grid, SE2(), 360, 4.5)
    assert ahead[0] == pytest.approx(1.51, abs=0.04)
    assert ahead[10] == pytest.approx(1.51 / np.cos(np.deg2rad(10)), abs=0.06)
    assert ahead[33] == pytest.approx(2.51 / np.cos(np.deg2rad(33)), abs=0.08)
    assert np.isinf(ahead[60:300]).all()
    turned = laser_scan(grid, SE2(0.5, 0.0, np.pi / 2), 360, 4.5)
    assert turned[270] == pytest.approx(1.01, abs=0.04)
    assert np.isinf(laser_scan(grid, SE2(), 360, 1.0)).all()
