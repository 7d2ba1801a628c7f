"""Goals of users, in any frame that their tools use, become goals in the map."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.control.localization import UNLOCALIZED, LocalizationState
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.goal_frames import in_map
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Refusal
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import TrackingState

T_MAP_BASE, T_ODOM_BASE = SE2(1.0, 2.0, 0.5 * math.pi), SE2(-3.0, 0.5, 0.0)
WHERE = LocalizationState(T_map_base=T_MAP_BASE, odometry=Odometry(0, T_ODOM_BASE), slam_state=TrackingState.GOOD)


@pytest.mark.parametrize("frame", ["map", "odom", "base_link", "base_footprint"])
def test_a_metre_ahead_is_the_same_place_in_every_frame(frame: str) -> None:
    T_frame_base = {"map": T_MAP_BASE, "odom": T_ODOM_BASE}.get(frame, SE2())
    goal = in_map(T_frame_base @ SE2(1.0, 0.0, 0.3), frame, WHERE)
    assert goal.as_array() == pytest.approx([1.0, 3.0, 0.5 * math.pi + 0.3])


@pytest.mark.parametrize("frame", ["", "camera_link", "robot2/odom", "odom_blind"])
def test_any_other_frame_is_named(frame: str) -> None:
    with pytest.raises(InputError, match=f"base_footprint or base_link, not in frame {frame!r}"):
        in_map(SE2(), frame, WHERE)


@pytest.mark.parametrize("where", [UNLOCALIZED, WHERE._replace(T_map_base=None)])
@pytest.mark.parametrize("frame", ["odom", "base_link"])
def test_without_a_place_in_the_map_there_is_no_goal(frame: str, where: LocalizationState) -> None:
    with pytest.raises(InputError, match=f"frame '{frame}' is planned in the map, .*wait until the camera tracks"):
        in_map(SE2(), frame, where)


def test_a_known_wall_is_in_the_way_of_a_goal_by_odometry() -> None:
    data = np.zeros((60, 60), np.int8)
    data[:, 30] = OCCUPIED
    planner = GoalPlanner(Config(), "fov", 1)
    planner.take_grid(OccupancyGrid(data, 0.05, 0.0, 0.0), 1)
    here = WHERE._replace(T_map_base=SE2(1.0, 1.5, 0.0))
    goal = in_map(T_ODOM_BASE @ SE2(1.2, 0.0, 0.0), "odom", here)
    assert isinstance(planner.plan(SE2(1.0, 1.5, 0.0), goal, "map"), Refusal)
