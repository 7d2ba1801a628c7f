"""The rest of a drive is compared with a newer map: an obstacle on it is told, one passed or beside it is not."""

import numpy as np
import pytest

from vsx_ros.config import LimitsConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.planning import corridor
from vsx_ros.planning.corridor import braking_before, obstacle_ahead, planned_clearance
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Trajectory
from vsx_ros.planning.retiming import Timing, retime
from vsx_ros.planning.time_scaling import time_scale

RADIUS_M = 0.18
WAY_M = np.linspace(0.0, 4.0, 401)
STRAIGHT = Trajectory(
    10.0 * WAY_M, np.stack([WAY_M, 0.0 * WAY_M, 0.0 * WAY_M], axis=1), np.full(401, 0.1), np.zeros(401)
)


def with_post(x: float, y: float, value: int = OCCUPIED) -> OccupancyGrid:
    """Open floor, but for one cell of 5 cm."""
    data = np.zeros((120, 160), np.int8)
    data[int((y + 3.0) / 0.05), int((x + 2.0) / 0.05)] = value
    return OccupancyGrid(data, 0.05, -2.0, -3.0)


@pytest.mark.parametrize("y", [0.01, -0.16, 0.16])
def test_an_obstacle_on_the_way_is_told_with_its_distance(y: float):
    said = obstacle_ahead(STRAIGHT, 5.0, with_post(1.5, y), RADIUS_M)
    assert said is not None
    assert 0.8 <= said < 0.95


@pytest.mark.parametrize("post", [(1.5, 0.3), (1.5, -0.3), (0.2, 0.01), (3.5, 0.01)])
def test_beside_behind_and_far_ahead_is_none(post: tuple[float, float]):
    assert obstacle_ahead(STRAIGHT, 5.0, with_post(*post), RADIUS_M) is None


@pytest.mark.parametrize(("gap_m", "told"), [(0.005, True), (0.013, True), (0.025, False), (0.04, False)])
def test_what_the_body_would_pass_at_less_than_the_map_may_be_off_is_told(gap_m: float, told: bool):
    grid = with_post(1.5, 0.21)  # its edge is 20 cm from the way
    moved = OccupancyGrid(grid.data, grid.resolution, grid.origin_x, grid.origin_y + RADIUS_M + gap_m - 0.2)
    said = obstacle_ahead(STRAIGHT, 5.0, moved, RADIUS_M, np.full(401, 0.25))
    assert (said is not None) == told


def test_only_the_ground_that_is_watched_costs_time(monkeypatch: pytest.MonkeyPatch):
    searched = []

    def field_of(grid: OccupancyGrid, reach_m: float) -> DistanceField:
        searched.append(grid.shape)
        return clearance_field(grid, reach_m)

    monkeypatch.setattr(corridor, "clearance_field", field_of)
    data = np.zeros((2000, 3000), np.int8)
    data[1000, 1500:1503] = OCCUPIED
    said = obstacle_ahead(STRAIGHT, 5.0, OccupancyGrid(data, 0.05, -73.5, -50.0), RADIUS_M)
    assert said == pytest.approx(0.83, abs=0.03)
    assert max(searched[0]) < 100


def test_what_is_unknown_is_no_obstacle():
    assert obstacle_ahead(STRAIGHT, 5.0, with_post(1.5, 0.01, UNKNOWN), RADIUS_M) is None


def test_a_base_that_stands_closer_already_may_leave_but_not_approach():
    grid = with_post(0.5, 0.1)
    assert obstacle_ahead(STRAIGHT, 5.2, grid, RADIUS_M) is None
    assert obstacle_ahead(STRAIGHT, 3.0, grid, RADIUS_M) is not None


def test_where_the_plan_had_little_room_so_little_is_not_news_but_less_is():
    near, nearer = with_post(1.5, 0.16), with_post(1.5, 0.11)
    planned_m = planned_clearance(STRAIGHT, near, RADIUS_M)
    assert planned_m.shape == (401,)
    assert planned_m.min() == pytest.approx(0.15, abs=0.01)
    for at_s in (0.0, 5.0, 9.03, 12.0):
        assert obstacle_ahead(STRAIGHT, at_s, near, RADIUS_M, planned_m) is None
    assert obstacle_ahead(STRAIGHT, 5.0, nearer, RADIUS_M, planned_m) is not None
    assert obstacle_ahead(STRAIGHT, 5.0, with_post(1.2, 0.16), RADIUS_M, planned_m) is not None


def test_an_obstacle_where_the_plan_knew_nothing_is_news():
    planned_m = planned_clearance(STRAIGHT, with_post(1.5, 0.16, UNKNOWN), RADIUS_M)
    assert obstacle_ahead(STRAIGHT, 5.0, with_post(1.5, 0.16), RADIUS_M, planned_m) is not None


def test_a_drive_of_one_sample_has_a_clearance_without_the_compiler():
    stay = Trajectory(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    assert planned_clearance(stay, with_post(0.2, 0.01), RADIUS_M) == pytest.approx([0.2], abs=0.03)


def test_on_bends_too_the_nearest_obstacle_that_is_braked_for_softly_is_not_come_too_near() -> None:
    limits, rng, judged = LimitsConfig(), np.random.default_rng(1), 0
    for _ in range(12):
        path = connect(SE2(), SE2(*rng.uniform(-2.0, 2.0, 2), rng.uniform(-3.0, 3.0)), 2.0)
        assert isinstance(path, Path)
        way = time_scale(path, limits)
        for at_s in rng.uniform(0.0, way.duration_s, 8):
            v = abs(way.at(at_s)[1])
            held = retime(way, Timing(way, way.times_s), at_s, 0.0, limits)
            if v < 0.15 or held is None:
                continue
            stop_m = float(np.hypot(*np.diff(held.trajectory.poses[:, :2], axis=0).T).sum())
            left_m = 0.07  # so near it must not brake softly
            wanted = braking_before(stop_m + v * limits.reaction_s + left_m, v, limits, way, at_s)
            assert wanted > limits.a_m_s2
            judged += 1
    assert judged > 30
