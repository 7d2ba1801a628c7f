"""What the explorer believes to see is what the camera sees, whatever its lens."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.exploration.utility import Ranking, RankingInput
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import view_rad
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.unknown_ground import looks_so_far
from vsx_ros.planning.path import Plan
from vsx_ros.robot import MAP_FRAME
from vsx_ros.system import ExplorationSystem

OPEN = OccupancyGrid(np.zeros((200, 200), np.int8), 0.05, -5.0, -5.0)
CELL_RAD = 0.05  # of bearing: half a cell at 0.5 m


def camera(fx: float) -> PinholeCamera:
    return PinholeCamera(640, 480, fx, fx, 319.5, 239.5)


def half_rad(fx: float) -> float:
    return math.atan(320.0 / fx)


def fan(least_rad: float, most_rad: float) -> np.ndarray:
    """100 landmarks 3 m away, half of them at bearings to the left and half to the right."""
    bearings = np.linspace(least_rad, most_rad, 50)
    bearings = np.concatenate([bearings, -bearings])
    return np.column_stack([3.0 * np.cos(bearings), 3.0 * np.sin(bearings), np.full(100, 0.5)])


def lock_step(fx: float) -> ExplorationSystem:
    return ExplorationSystem(camera(fx), mounted(Config().robot.mount), Config(), seed=1)


@pytest.mark.parametrize("fx", [350.0, 525.0, 700.0])
def test_ground_counts_as_looked_at_only_where_it_is_in_the_image(fx: float, monkeypatch: pytest.MonkeyPatch) -> None:
    selector, asked = lock_step(fx).mission.view_selector, list[RankingInput]()
    monkeypatch.setattr(selector, "_rank", lambda given: asked.append(given) or Ranking([], {}))
    selector.rank(0, SE2(), OPEN, fan(0.0, 1.0))
    looked = looks_so_far(OPEN, np.zeros((1, 3)), asked[0].config).halves.any(axis=2)
    middles = OPEN.centres(np.argwhere(looked))
    far = np.hypot(*middles.T) > 0.5
    bearings = np.abs(np.arctan2(middles[far, 1], middles[far, 0]))
    assert 0.9 * half_rad(fx) < bearings.max() < half_rad(fx) + CELL_RAD


@pytest.mark.parametrize("fx", [350.0, 525.0, 700.0])
def test_landmarks_count_where_they_are_in_the_image(fx: float) -> None:
    selector, half = lock_step(fx).mission.view_selector, half_rad(fx)
    inside, outside = fan(0.0, 0.95 * half), fan(1.05 * half, 1.2 * half)
    here = np.zeros((1, 3))
    assert selector.count_landmarks(OPEN, here, inside).tolist() == [100]
    assert selector.count_landmarks(OPEN, here, outside).tolist() == [0]


@pytest.mark.parametrize(("fx", "seen"), [(350.0, True), (525.0, False), (700.0, False)])
def test_a_way_is_blind_where_the_camera_does_not_see_the_landmarks(fx: float, *, seen: bool) -> None:
    """Landmarks 37 degrees or more to both sides of a straight way."""
    away_m = np.linspace(3.0, 4.5, 200)
    sides = [np.column_stack([away_m * math.cos(a), away_m * math.sin(a), 0.0 * away_m]) for a in (0.64, -0.64)]
    of_node = GoalPlanner(Config(), "fov", 1)
    of_node.look_with(view_rad(camera(fx)))
    for planner in (lock_step(fx).planner, of_node):
        planner.take_grid(OPEN, 0)
        planner.take_landmarks(np.vstack(sides), 0)
        plan = planner.plan(SE2(), SE2(0.4, 0.0, 0.0), MAP_FRAME)
        assert isinstance(plan, Plan)
        assert (float(np.sum(np.diff(plan.blind_spans))) < 0.1) is seen
