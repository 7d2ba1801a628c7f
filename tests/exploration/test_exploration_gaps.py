"""Views behind narrow gaps."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.planning.planner import Planner

CONFIG = Config()
NARROW = 11  # cells: 9 cm beside the body
LANDMARKS = np.random.default_rng(0).uniform([-5.0, -2.0, 0.0], [5.0, 2.0, 1.0], (2000, 3))


def hall(gap_cells: int, west: int) -> OccupancyGrid:
    """A hall with a gap in its eastern wall, and unknown ground behind that. west: what its far end is."""
    data = np.full((80, 240), UNKNOWN, np.int8)
    data[:, 40:200] = FREE
    data[:, :40] = west
    data[:2], data[-2:], data[:, 140:143] = OCCUPIED, OCCUPIED, OCCUPIED
    data[40 : 40 + gap_cells, 140:143] = FREE
    return OccupancyGrid(data, 0.05, -6.0, -2.0)


@pytest.mark.parametrize("gap_cells", [NARROW, 18])
def test_views_behind_a_narrow_gap_come_when_no_other_is_left(gap_cells: int) -> None:
    """The hall's other end is farther from here. A gap of 90 cm leaves enough room beside the body."""
    ways, here = Planner(CONFIG.planner, CONFIG.robot), SE2(0.3, 0.1, 0.0)
    first, rest = (
        ViewSelector(CONFIG, ways.travel_costs).rank(0, here, hall(gap_cells, west), LANDMARKS).views
        for west in (UNKNOWN, OCCUPIED)
    )
    assert first
    assert rest
    is_narrow = gap_cells == NARROW
    assert any(view.pose.x > 1.2 for view in first) is not is_narrow
    assert all(view.pose.x > 1.2 for view in rest)


def test_a_narrow_gap_is_better_than_to_lose_the_map() -> None:
    """Before the other views are few landmarks."""
    ways, here = Planner(CONFIG.planner, CONFIG.robot), SE2(0.3, 0.1, 0.0)
    behind = LANDMARKS[LANDMARKS[:, 0] > 1.5]
    few = LANDMARKS[LANDMARKS[:, 0] < -4.0][:7]
    views = ViewSelector(CONFIG, ways.travel_costs).rank(0, here, hall(NARROW, UNKNOWN), np.vstack([behind, few])).views
    assert views[0].pose.x > 1.2
    assert views[0].landmarks >= CONFIG.exploration.min_landmarks
