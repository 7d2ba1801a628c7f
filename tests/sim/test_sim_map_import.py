import os
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.errors import MapFileError
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.runs.world import open_world
from vsx_ros.sim.generate import free_space_outlines, world_from_grid
from vsx_ros.sim.scene import quads
from vsx_ros.sim.truth import free_ahead, ground_truth_grid

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[2] / "../shared/data"))
REAL = ["maps/lab_ipa.png", "maps/Freiburg52_scan.png", "maps/office_b.png",
        "aws_small_house/maps/turtlebot3_waffle_pi/map.pgm"]  # fmt: skip


def hall() -> OccupancyGrid:
    """A hall of 6 m x 4 m with a pillar of 0.5 m, 5 cm cells, and a separate closet."""
    data = np.full((100, 160), UNKNOWN, np.int8)
    data[8:92, 8:132] = OCCUPIED
    data[10:90, 10:130] = FREE
    data[40:50, 60:70] = OCCUPIED
    data[20:30, 140:150] = FREE
    return OccupancyGrid(data, 0.05, -1.0, 2.0)


def test_outlines_follow_the_free_space_with_it_to_the_left() -> None:
    loops = free_space_outlines(hall())
    assert len(loops) == 2
    areas = sorted(0.5 * float(np.sum(p[:, 0] * np.roll(p[:, 1], -1) - np.roll(p[:, 0], -1) * p[:, 1])) for p in loops)
    assert areas[0] == pytest.approx(-0.25, abs=0.12)
    assert areas[1] == pytest.approx(24.0, abs=0.6)


def test_the_world_of_a_map_has_the_map_as_its_truth() -> None:
    grid = hall()
    world = world_from_grid(grid, "hall", 3)
    truth = ground_truth_grid(world, 0.05, 0.06, 0.6)
    rows, columns = np.nonzero(grid.data == FREE)
    cells = np.column_stack([rows, columns])[columns < 135]
    same = [truth.value_at(float(x), float(y)) == FREE for x, y in grid.centres(cells)[::23]]
    assert np.mean(same) > 0.97
    assert truth.value_at(-1.0 + 65 * 0.05, 2.0 + 45 * 0.05) != FREE  # the pillar
    assert truth.value_at(-1.0 + 145 * 0.05, 2.0 + 25 * 0.05) != FREE  # the closet
    assert free_ahead(world, world.start.x, world.start.y, world.start.theta_rad) >= 1.2
    assert len(quads(world)) > 10
    assert world == world_from_grid(grid, "hall", 3)


@pytest.mark.parametrize("name", REAL)
def test_a_robot_can_begin_in_the_map_of_a_real_building(name: str) -> None:
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent (set VSX_DATA)")
    world = open_world(str(DATA / name), 100)
    truth = ground_truth_grid(world, 0.05, 0.06, 0.6)
    assert truth.value_at(world.start.x, world.start.y) == FREE
    assert free_ahead(world, world.start.x, world.start.y, world.start.theta_rad) >= 1.2
    assert np.count_nonzero(truth.data == FREE) * 0.05**2 > 25.0
    assert len(quads(world)) > 20


def test_the_robot_begins_in_the_largest_region_and_not_in_the_roundest() -> None:
    data = np.full((100, 320), UNKNOWN, np.int8)
    data[10:30, 10:310] = FREE  # 15 m x 1 m
    data[40:90, 10:60] = FREE  # 2.5 m x 2.5 m
    world = world_from_grid(OccupancyGrid(data, 0.05, 0.0, 0.0), "passage", 1)
    assert 0.5 < world.start.y < 1.5


def test_a_map_without_free_space_is_refused() -> None:
    data = np.full((50, 50), OCCUPIED, np.int8)
    data[3:6, 3:6] = FREE
    with pytest.raises(MapFileError, match="1 m2"):
        world_from_grid(OccupancyGrid(data, 0.05, 0.0, 0.0), "x", 0)
