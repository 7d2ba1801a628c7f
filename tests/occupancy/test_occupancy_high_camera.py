"""Rays of a camera above the obstacles pass over them: they prove the floor free only where they come down."""

import itertools

import numpy as np
import pytest

from vsx_ros.config import GroundMapConfig, RobotConfig
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.ground_map import GroundMap

NEAR = pytest.mark.parametrize(("height_m", "near"), [(0.31, FREE), (1.0, UNKNOWN)])


def built(points: np.ndarray, height_m: float, surfaces: Surfaces | None = None) -> OccupancyGrid:
    """Four keyframes at this height see all points."""
    mount = mount_pose(-0.09, 0.0, height_m, 0.0)
    poses = [SE3.from_se2(SE2(-0.15 * i, 0.1 * (i % 2), 0.0)) @ mount for i in range(4)]
    keyframe, point = np.repeat(np.arange(4), len(points)), np.tile(np.arange(len(points)), 4)
    return GroundMap(GroundMapConfig(), RobotConfig()).build(poses, points, keyframe, point, surfaces=surfaces)


def across(x: float, z: float = 0.0) -> np.ndarray:
    """Points in a row across the way, this far ahead."""
    return np.array([[x, y, z] for y in np.linspace(-0.6, 0.6, 80)])


def wall(x: float) -> Surfaces:
    """Across the way; all keyframes see its foot."""
    y, z = (a.ravel() for a in np.meshgrid(np.arange(-0.6, 0.6, 0.02), np.arange(0.08, 0.5, 0.02)))
    spots = np.column_stack([np.full(len(y), x), y, z])
    keyframe, shown = np.zeros(len(y), int), np.flatnonzero(z < 0.1)
    witnesses = np.tile(shown, 3), np.repeat([1, 2, 3], len(shown))
    return Surfaces(spots, keyframe, np.full(len(y), 0.001), *witnesses)


@NEAR
def test_floor_at_four_metres_proves_nothing_nearer_than_the_rays_come_down(height_m, near):
    grid = built(across(4.0), height_m)
    assert grid.value_at(1.0, 0.0) == near
    assert grid.value_at(3.5, 0.0) == FREE


@NEAR
def test_nor_does_the_foot_of_a_wall(height_m, near):
    grid = built(np.zeros((0, 3)), height_m, wall(4.0))
    assert grid.value_at(1.0, 0.0) == near
    assert grid.value_at(3.5, 0.0) == FREE


@pytest.mark.parametrize("rows", [(2.0, 5.0), (5.0, 2.0)])
def test_nor_do_two_rays_prove_the_ground_between_their_low_stretches(rows):
    grid = built(np.vstack([across(x) for x in rows]), 1.0)
    assert [grid.value_at(x, 0.0) for x in (0.7, 1.6, 2.2, 2.5, 3.5, 4.3)] == [
        UNKNOWN, FREE, UNKNOWN, UNKNOWN, FREE, FREE,
    ]  # fmt: skip


def test_nor_does_a_foot_behind_the_floor():
    grid = built(across(2.0), 1.0, wall(5.0))
    assert [grid.value_at(x, 0.0) for x in (1.6, 2.2, 2.5, 4.0)] == [FREE, UNKNOWN, UNKNOWN, FREE]


def test_nor_does_a_ray_whose_end_is_unsure_by_more_than_its_low_stretch():
    grid = built(np.vstack([across(2.0), across(5.0, 0.38)]), 1.0)
    assert [grid.value_at(x, 0.0) for x in (1.6, 2.2, 2.5, 4.0)] == [FREE, UNKNOWN, UNKNOWN, UNKNOWN]


@pytest.mark.parametrize("rows", [*itertools.permutations((2.0, 3.0, 4.5))])
def test_stretches_that_overlap_are_joined_in_any_order(rows):
    grid = built(np.vstack([across(x) for x in rows]), 1.0)
    assert {grid.value_at(x, 0.0) for x in np.arange(1.4, 4.0, 0.05)} == {FREE}


def test_a_foot_joins_the_floor_before_it():
    grid = built(across(2.0), 1.0, wall(3.0))
    assert {grid.value_at(x, 0.0) for x in np.arange(1.4, 2.85, 0.05)} == {FREE}


def test_a_surface_ends_the_farther_stretch_too():
    high = wall(4.0)
    grid = built(np.vstack([across(2.0), across(5.0)]), 1.0, high._replace(points=high.points + (0.0, 0.0, 0.1)))
    assert grid.value_at(3.6, 0.0) == FREE
    assert grid.value_at(4.4, 0.0) != FREE
