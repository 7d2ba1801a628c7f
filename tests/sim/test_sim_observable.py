from __future__ import annotations

import math

import numpy as np

from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.observable import mark_seen
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.sim.observable import observable_cells, reachable_cells
from vsx_ros.sim.placement import is_connected
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import World


def two_rooms(door: int) -> OccupancyGrid:
    """Two rooms of 2 m x 2 m side by side, 0.1 m cells, with a door of so many cells."""
    data = np.full((24, 46), UNKNOWN, np.int8)
    data[1:23, 1:45] = OCCUPIED
    data[2:22, 2:22] = FREE
    data[2:22, 24:44] = FREE
    data[12 - door // 2 : 12 - door // 2 + door, 22:24] = FREE
    return OccupancyGrid(data, 0.1, 0.0, 0.0)


def test_a_narrow_door_lets_the_eye_through_but_not_the_robot() -> None:
    start, right_room = SE2(1.2, 1.2, 0.0), np.s_[2:22, 24:44]
    shut, narrow, wide = (two_rooms(door) for door in (0, 3, 8))
    assert not reachable_cells(narrow, start, 0.2)[right_room].any()
    assert reachable_cells(wide, start, 0.2)[right_room].any()
    seen = [observable_cells(grid, start, 0.2, 4.0)[right_room].mean() for grid in (shut, narrow, wide)]
    assert seen[0] == 0.0
    assert 0.1 < seen[1] < 0.95
    assert seen[2] > 0.97


def test_range_limits_what_is_seen_and_walls_count() -> None:
    grid = two_rooms(0)
    near = observable_cells(grid, SE2(1.2, 1.2), 0.8, 0.5)
    full = observable_cells(grid, SE2(1.2, 1.2), 0.2, 4.0)
    assert 0 < near.sum() < 0.5 * full.sum()
    assert full[1, 10]  # the wall itself
    assert not full[0, 10]  # nothing behind it


def test_a_robot_that_does_not_fit_sees_nothing() -> None:
    grid = two_rooms(8)
    assert not observable_cells(grid, SE2(0.25, 0.25), 0.3, 4.0).any()
    assert not observable_cells(grid, SE2(-5.0, 0.0), 0.2, 4.0).any()


def test_mark_seen_is_what_fine_steps_along_rays_see() -> None:
    rng = np.random.default_rng(4)
    blocked = rng.random((40, 50)) < 0.06
    blocked[20, 25] = False
    reach = 15.0
    seen = np.zeros_like(blocked)
    mark_seen(blocked, np.array([[20, 25]]), reach, seen)
    twin = np.zeros_like(blocked)
    rays = math.ceil(2 * math.pi * reach)
    for k in range(rays):
        angle = 2 * math.pi * k / rays
        for step in np.arange(0.0, reach, 0.001):
            row, column = math.floor(20.5 + step * math.sin(angle)), math.floor(25.5 + step * math.cos(angle))
            twin[row, column] = True
            if blocked[row, column]:
                break
    assert (seen ^ twin).sum() <= 0.01 * twin.sum() + 4  # rays that pass through a corner, and the last cell
    assert twin.sum() > 200


def test_ground_truth_of_a_known_room(room_with_box: World) -> None:
    grid = ground_truth_grid(room_with_box, 0.05, 0.06, 0.6)
    free_area = (grid.data == FREE).sum() * 0.05**2
    assert abs(free_area - (24.0 - 0.8)) < 0.6
    assert grid.value_at(3.02, 2.0) == OCCUPIED
    assert grid.value_at(3.5, 2.0) == UNKNOWN  # inside the box
    assert grid.value_at(2.9, 2.0) == FREE
    assert grid.value_at(-0.05, 2.0) == OCCUPIED
    assert grid.value_at(-0.25, 2.0) == UNKNOWN
    above = ground_truth_grid(room_with_box, 0.05, 0.6, 0.9)
    assert above.value_at(3.02, 2.0) == FREE  # the box ends below


def test_tables_block_by_their_legs_only(lab: World) -> None:
    table = lab.tables[0]
    low, high = ground_truth_grid(lab, 0.02, 0.06, 0.6), ground_truth_grid(lab, 0.02, 0.70, 0.80)
    assert low.value_at(table.x, table.y) == FREE
    assert high.value_at(table.x, table.y) != FREE
    assert is_connected(lab)


def test_nearly_all_of_a_lab_is_observable(lab: World) -> None:
    grid = ground_truth_grid(lab, 0.05, 0.06, 0.6)
    mask = observable_cells(grid, lab.start_pose, 0.18, 4.0)
    assert mask[grid.data == FREE].mean() > 0.97
    assert not mask[grid.data == UNKNOWN].any()
