import numpy as np
import pytest

pytest.importorskip("rospy")

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros.slam_input import RepeatedImageDetector


def picture(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (48, 64), np.uint8)


def at(x: float, theta: float = 0.0) -> Odometry:
    return Odometry(0, SE2(x, 0.0, theta))


def test_different_pictures_are_new_wherever_the_base_is() -> None:
    watch = RepeatedImageDetector()
    assert [watch.is_new(picture(k), at(0.1 * k)) for k in range(3)] == [True] * 3


@pytest.mark.parametrize("moved", [at(0.01), at(0.0, 0.02)])
def test_the_same_picture_is_old_once_the_base_has_moved_and_stays_so(moved: Odometry) -> None:
    watch = RepeatedImageDetector()
    told = [watch.is_new(picture(0), where) for where in (at(0.0), at(0.001), moved, moved, moved)]
    assert told == [True, True, False, False, False]
    assert watch.is_new(picture(1), moved)


def test_creeping_is_motion() -> None:
    watch = RepeatedImageDetector()
    assert [watch.is_new(picture(0), at(0.002 * k)) for k in range(6)] == [True] * 3 + [False] * 3


def test_without_wheels_nothing_is_known() -> None:
    watch = RepeatedImageDetector()
    assert [watch.is_new(picture(0), odometry) for odometry in (at(0.0), None, at(1.0), None)] == [True] * 4
