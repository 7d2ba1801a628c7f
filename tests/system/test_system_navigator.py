"""Plans keep the map in view, are slowed while tracking is dubious, and made anew where the base strayed."""

import numpy as np
import pytest

from vsx_ros.config import Config, FollowerConfig
from vsx_ros.control.pose_fusion import PoseFuser
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.unicycle import integrate
from vsx_ros.navigator import Navigator, Surroundings
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.planning.planner import Planner
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import TrackingState

STEP_NS = 33_333_333
OPEN = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, -4.0, -4.0)
UNSEEN = Surroundings(OPEN, np.zeros((0, 3)))


class Base:
    """Drives as it is told and knows where it is."""

    def __init__(self, replans: int = 2) -> None:
        config = Config(follower=FollowerConfig(replans_after_divergence=replans))
        self.navigator = Navigator(config, Planner(config.planner, config.robot), 0)
        self.fuser, self.pose, self.now_ns, self.speeds = PoseFuser(), SE2(), 0, [0.0]
        self.omega, self.around = 0.0, UNSEEN

    def go(self, goal: SE2, around: Surroundings) -> None:
        self.navigator.go(self.now_ns, self.pose, goal, "map", around)

    def drive(self, seconds: float, state: TrackingState = TrackingState.GOOD) -> None:
        for _ in range(round(seconds * 30)):
            if self.navigator.state is not NavigationState.ACTIVE:
                return
            self.now_ns += STEP_NS
            odometry = Odometry(self.now_ns, self.pose, self.speeds[-1], self.omega)
            self.fuser.add_odometry(odometry)
            self.fuser.add_slam(self.now_ns, self.pose)
            command = self.navigator.command(self.now_ns, odometry, self.fuser, state, self.around).command
            self.speeds.append(command.v)
            self.omega = command.omega
            self.pose = integrate(self.pose, command.v / 30, command.omega / 30)

    def pushed(self) -> None:
        self.pose = self.pose @ SE2(0.0, 0.2, 0.0)


def test_a_base_pushed_off_its_path_stops_and_plans_again():
    base, goal = Base(), SE2(2.5, 0.5, 0.3)
    base.go(goal, UNSEEN)
    for _ in range(2):
        base.drive(3.0)
        base.pushed()
    base.drive(60.0)
    assert base.navigator.state is NavigationState.SUCCEEDED
    assert base.pose.distance_to(goal) < 0.02
    assert base.navigator.plans == 3
    assert 0.0 in base.speeds[30:-30]


def test_a_base_that_strays_again_and_again_gives_up_with_the_reason():
    base = Base(replans=1)
    base.go(SE2(2.5, 0.5, 0.3), UNSEEN)
    for _ in range(2):
        base.drive(3.0)
        assert base.navigator.state is NavigationState.ACTIVE
        base.pushed()
    base.drive(3.0)
    assert base.navigator.state is NavigationState.ABORTED
    assert "beside the path" in base.navigator.reason
    assert base.navigator.plans == 2


def test_dubious_tracking_is_driven_slowly_and_lost_not_at_all():
    base = Base()
    base.go(SE2(3.0, 0.0, 0.0), UNSEEN)
    base.drive(4.0)
    assert base.speeds[-1] == pytest.approx(0.3, abs=0.01)
    base.drive(2.0, TrackingState.DUBIOUS)
    assert base.speeds[-1] == pytest.approx(0.15, abs=0.01)
    base.drive(2.0, TrackingState.LOST)
    assert base.speeds[-1] == 0.0
    base.drive(30.0)
    assert base.navigator.state is NavigationState.SUCCEEDED
    assert np.abs(np.diff(base.speeds)).max() <= 0.4 / 30 * 1.01 + 1e-9


def test_a_way_out_of_sight_of_the_map_is_refused():
    rng = np.random.default_rng(0)
    wall = np.stack([np.full(400, 3.5), rng.uniform(-3, 3, 400), rng.uniform(0, 1, 400)], axis=1)
    base = Base()
    base.go(SE2(-3.0, 0.5, 3.1), Surroundings(OPEN, wall))
    assert base.navigator.state is NavigationState.ABORTED
    assert "landmarks in view" in base.navigator.reason
    base.go(SE2(1.0, 0.3, 0.1), Surroundings(OPEN, wall))
    assert base.navigator.state is NavigationState.ACTIVE


def with_box(x: slice, y: slice) -> Surroundings:
    """The open floor with a box on it [cells]."""
    data = OPEN.data.copy()
    data[y, x] = OCCUPIED
    return Surroundings(OccupancyGrid(data, 0.05, -4.0, -4.0), np.zeros((0, 3)))


def test_an_obstacle_that_comes_to_light_on_the_way_is_driven_around():
    base, goal = Base(), SE2(3.0, 0.0, 0.0)
    base.go(goal, UNSEEN)
    base.drive(2.0)
    base.around = with_box(slice(108, 116), slice(76, 84))
    middle, nearest_m = np.array([1.6, 0.0]), np.inf
    for _ in range(900):
        base.drive(0.1)
        nearest_m = min(nearest_m, float(np.hypot(base.pose.x - middle[0], base.pose.y - middle[1])))
    assert base.navigator.state is NavigationState.SUCCEEDED
    assert base.pose.distance_to(goal) < 0.02
    assert base.navigator.plans == 2
    assert nearest_m > 0.2 + 0.18


def test_what_comes_to_light_elsewhere_does_not_stop_the_base():
    base = Base()
    base.go(SE2(3.0, 0.0, 0.0), UNSEEN)
    base.drive(2.0)
    base.around = with_box(slice(108, 116), slice(88, 96))
    base.drive(60.0)
    assert base.navigator.state is NavigationState.SUCCEEDED
    assert base.navigator.plans == 1
