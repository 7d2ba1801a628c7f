"""Views judged by what the way to them shows."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config, overridden
from vsx_ros.exploration.along import unknown_area_along, ways_of, with_ways
from vsx_ros.exploration.utility import Ranking, Rejection, View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.planning.planner import Planner

CONFIG = overridden(Config(), {"exploration.way_gain_ratio": 0.3})
SENSOR = overridden(Config(), {"exploration.sensor_fov_rad": 1.0, "exploration.sensor_range_m": 2.0}).exploration
NO_LOOKS = np.zeros((0, 3))


def strip(unknown_rows: slice) -> OccupancyGrid:
    """12 m x 8 m of free floor, walled, with rows nobody knows."""
    data = np.full((160, 240), FREE, np.int8)
    data[unknown_rows, 1:-1] = UNKNOWN
    data[[0, -1], :] = data[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


def area(grid: OccupancyGrid, poses: list[tuple[float, float, float]], worth: float = 1.0) -> float:
    everywhere = np.full((8, *grid.data.shape), worth)
    return unknown_area_along(np.array(poses), grid, everywhere, SENSOR)


def test_a_field_of_view_over_unknown_ground_shows_its_sector_once():
    grid = OccupancyGrid(np.full((160, 240), UNKNOWN, np.int8), 0.05, 0.0, 0.0)
    sector_m2 = 0.5 * 2.0**2
    assert area(grid, [(6.0, 4.0, 0.3)]) == pytest.approx(sector_m2, rel=0.06)
    assert area(grid, [(6.0, 4.0, 0.3)] * 3) == area(grid, [(6.0, 4.0, 0.3)])
    assert area(grid, [(6.0, 4.0, 0.3), (6.0, 4.0, 0.3 + math.pi)]) == pytest.approx(2 * sector_m2, rel=0.06)
    assert area(grid, [(6.0, 4.0, 0.3)], 0.25) == pytest.approx(0.25 * area(grid, [(6.0, 4.0, 0.3)]))


def test_walls_hide_what_is_behind_them():
    grid = strip(slice(100, 160))
    seen = area(grid, [(6.0, 4.0, math.pi / 2)])
    grid.data.flags.writeable = True
    grid.data[95, :] = OCCUPIED
    assert seen > 0.3
    assert area(grid, [(6.0, 4.0, math.pi / 2)]) == 0.0


def two_views() -> Ranking:
    """Two of the same utility, of which the way to the second one passes by what nobody knows."""
    bare, showing = SE2(2.0, 2.0, math.pi), SE2(10.0, 2.0, 0.0)
    views = [View(pose, 1.0, 4.0, 60, 1.0 / (4.0 + CONFIG.exploration.stop_cost_m)) for pose in (bare, showing)]
    return Ranking(views, dict.fromkeys(Rejection, 0))


def test_a_way_that_shows_more_is_worth_more_and_its_length_is_the_planned_one():
    grid = strip(slice(60, 80))

    def way_to(goal: SE2) -> np.ndarray:
        looking = math.pi if goal.x < 6.0 else math.pi / 2
        return np.array([[x, 2.0, looking] for x in np.linspace(6.0, goal.x, 11)])

    first, second = with_ways(two_views(), way_to, grid, 0.2, NO_LOOKS, CONFIG.exploration).views
    assert first.pose.x == 10.0
    assert first.gain_m2 > 2.0 * second.gain_m2
    assert first.distance_m == pytest.approx(4.0)
    assert first.utility == pytest.approx(first.gain_m2 / (4.0 + CONFIG.exploration.stop_cost_m))


def test_views_without_a_way_fall_out_and_are_counted():
    ranking = with_ways(two_views(), lambda goal: None, strip(slice(60, 80)), 0.2, NO_LOOKS, CONFIG.exploration)
    assert not ranking.views
    assert ranking.rejected[Rejection.UNREACHABLE] == 2


def test_views_alike_are_planned_to_once():
    views = [View(SE2(2.0 + 0.1 * k, 2.0, 0.0), 1.0, 4.0, 60, 1.0 - 0.01 * k) for k in range(5)]
    asked = []

    def way_to(goal: SE2) -> np.ndarray:
        asked.append(goal)
        return np.array([[6.0, 2.0, 0.0], [goal.x, 2.0, 0.0]])

    ranking = with_ways(Ranking(views, {}), way_to, strip(slice(60, 80)), 0.2, NO_LOOKS, CONFIG.exploration)
    assert asked == [views[0].pose]
    assert ranking.views[1:] == views[1:]


def test_planned_ways_lead_from_the_start_to_the_goal():
    start, goal = SE2(3.0, 4.0, 0.0), SE2(8.0, 5.0, 1.0)
    ways = ways_of(Planner(CONFIG.planner, CONFIG.robot))(start, strip(slice(0, 0)))
    way = ways(goal)
    assert way is not None
    assert way[0] == pytest.approx(start.as_array())
    assert way[-1, :2] == pytest.approx([8.0, 5.0], abs=1e-6)
    assert np.hypot(*np.diff(way[:, :2], axis=0).T).max() <= 0.3 + 1e-9
    assert ways(SE2(30.0, 5.0, 1.0)) is None
