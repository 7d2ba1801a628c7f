"""Two whole Gazebo worlds, if VSX_DATA has them: a furnished house and a warehouse."""

import os
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.io.map_file import load_map
from vsx_ros.occupancy.grid import OCCUPIED
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.mesh_world import SLICE_M
from vsx_ros.sim.truth import gap_to_walls, reachable_area_m2

DATA = Path(os.environ.get("VSX_DATA", "/nowhere"))
HOUSE = DATA / "gazebo_worlds/small_house/worlds/small_house.world"
WAREHOUSE = DATA / "gazebo_worlds/small_warehouse/worlds/no_roof_small_warehouse.world"
MAP = DATA / "aws_small_house/maps/turtlebot3_waffle_pi/map.yaml"


@pytest.mark.data
@pytest.mark.skipif(not (HOUSE.exists() and MAP.exists()), reason="no gazebo_worlds/small_house in VSX_DATA")
def test_the_house_is_where_its_own_map_has_it() -> None:
    world = load_gazebo(HOUSE, [])
    occupied = load_map(MAP)
    centres = occupied.centres(np.argwhere(occupied.data == OCCUPIED))
    segments = world.obstacle_segments(*SLICE_M)
    gaps = np.concatenate([gap_to_walls(segments, part) for part in np.array_split(centres, 40)])
    assert len(gaps) == 3442
    assert gaps.max() <= 0.05
    assert 110.0 < reachable_area_m2(world, 0.18) < 140.0
    assert 140_000 < len(world.parts.seen.corners) < 150_000
    assert abs(world.floor_z_m) < 0.01
    missing = " ".join(world.parts.remarks)
    assert "aws_Carpet_01.png" in missing


@pytest.mark.data
@pytest.mark.skipif(not WAREHOUSE.exists(), reason="no gazebo_worlds/small_warehouse in VSX_DATA")
def test_the_floor_of_the_warehouse_is_not_at_zero() -> None:
    world = load_gazebo(WAREHOUSE, [])
    assert world.floor_z_m == pytest.approx(0.034, abs=0.012)
    assert 180.0 < reachable_area_m2(world, 0.18) < 215.0
