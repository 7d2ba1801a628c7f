"""Rays of a camera above the obstacles pass over them: they prove the floor free only where they come down."""

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


@NEAR
def test_floor_at_four_metres_proves_nothing_nearer_than_the_rays_come_down(height_m, near):
    grid = built(np.array([[4.0, y, 0.0] for y in np.linspace(-0.6, 0.6, 80)]), height_m)
    assert grid.value_at(1.0, 0.0) == near
    assert grid.value_at(3.5, 0.0) == FREE


@NEAR
def test_nor_does_the_foot_of_a_wall(height_m, near):
    y, z = (a.ravel() for a in np.meshgrid(np.arange(-0.6, 0.6, 0.02), np.arange(0.08, 0.5, 0.02)))
    spots = np.column_stack([np.full(len(y), 4.0), y, z])
    keyframe, shown = np.zeros(len(y), int), np.flatnonzero(z < 0.1)
    witnesses = np.tile(shown, 3), np.repeat([1, 2, 3], len(shown))
    wall = Surfaces(spots, keyframe, np.full(len(y), 0.001), *witnesses)
    grid = built(np.zeros((0, 3)), height_m, wall)
    assert grid.value_at(1.0, 0.0) == near
    assert grid.value_at(3.5, 0.0) == FREE
