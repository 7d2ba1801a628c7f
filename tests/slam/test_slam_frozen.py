"""A camera that repeats one image to the bit while the base moves, and one without noise while it stands."""

import numpy as np
import pytest
from spoilt_drives import CONFIG

from vsx_ros.geometry.camera import nominal_camera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.preprocessing import Preprocessor
from vsx_ros.slam.slam import SequentialSlam

CAMERA = nominal_camera(160, 120)
MOUNT = mount_pose(0.0, 0.0, 0.3, 0.0)
PERIOD_NS = 100_000_000


def picture(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (120, 160), np.uint8)


def at(x: float, theta: float = 0.0, epoch: int = 0) -> Odometry:
    return Odometry(0, SE2(x, 0.0, theta), odom_epoch=epoch)


def told(places: list[Odometry | None], images: list[np.ndarray] | None = None) -> list[bool]:
    """What each result says, at ten images a second; by default one image again and again."""
    slam, images = SequentialSlam(CAMERA, MOUNT, CONFIG, 1), images or [picture(0)] * len(places)
    return [
        slam.track(
            Frame((k + 1) * PERIOD_NS, image), odometry and odometry._replace(stamp_ns=(k + 1) * PERIOD_NS)
        ).frozen
        for k, (odometry, image) in enumerate(zip(places, images))
    ]


@pytest.mark.parametrize("step_m", [0.005, 0.01, 0.002])
def test_one_image_is_frozen_once_the_base_has_moved_however_slowly(step_m: float) -> None:
    frozen = told([at(step_m * k) for k in range(60)])
    first = next(k for k in range(60) if step_m * k >= 0.006 - 1e-9)
    assert frozen == [False] * first + [True] * (60 - first)


def test_slow_turns_count_too() -> None:
    assert told([at(0.0, 0.004 * k) for k in range(6)]) == [False] * 3 + [True] * 3


def test_different_images_are_never_frozen() -> None:
    assert not any(told([at(0.1 * k) for k in range(5)], [picture(k) for k in range(5)]))


@pytest.mark.parametrize("moved", [at(0.01), at(0.0, 0.02)])
def test_it_stays_frozen_until_another_image_comes_also_where_it_was_taken(moved: Odometry) -> None:
    places = [at(0.0), at(0.001), moved, moved, at(0.0), at(0.0)]
    images = [picture(0)] * 5 + [picture(1)]
    assert told(places, images) == [False, False, True, True, True, False]


def test_without_wheels_nothing_is_known() -> None:
    assert told([at(0.0), None, at(1.0), None]) == [False] * 4


def test_a_base_that_counts_anew_has_not_moved() -> None:
    assert told([at(3.0), at(3.0), at(0.0, epoch=1), at(0.0, epoch=1), at(0.01, epoch=1)]) == [False] * 4 + [True]
    assert told([at(3.0), at(3.01), at(0.0, epoch=1), at(0.0, epoch=1)]) == [False] + [True] * 3


def test_a_gyro_that_drifts_for_an_hour_does_not_move_a_base_that_stands() -> None:
    """A simulated camera without noise repeats its image all the time."""
    preprocessor = Preprocessor(CAMERA, MOUNT, CONFIG, lambda *_: None)
    for k in range(1, 3000):
        odometry = at(1e-5 * k, 1e-4 * k)._replace(stamp_ns=k * PERIOD_NS)
        assert not preprocessor.take(Frame(k * PERIOD_NS, picture(0)), odometry, metric=True).frozen


@pytest.mark.parametrize("grey", [0, 255])
def test_an_image_without_light_is_frozen_for_the_drive_but_says_that_it_shows_nothing(grey: int) -> None:
    slam, blind = SequentialSlam(CAMERA, MOUNT, CONFIG, 1), np.full((120, 160), grey, np.uint8)
    for k in range(1, 4):
        result = slam.track(Frame(k * PERIOD_NS, blind), at(0.01 * k)._replace(stamp_ns=k * PERIOD_NS))
    assert result.frozen
    assert not [event for event in slam.drain_events() if "hangs" in event.reason]


def test_it_is_told_in_a_map_without_odometry_too() -> None:
    """A second map begins without scale: its odometry is not used, but the robot may drive by it."""
    preprocessor = Preprocessor(CAMERA, MOUNT, CONFIG, lambda *_: None)
    for k in range(1, 4):
        odometry = at(0.01 * k)._replace(stamp_ns=k * PERIOD_NS)
        data = preprocessor.take(Frame(k * PERIOD_NS, picture(0)), odometry, metric=False)
        assert data.T_odom_base is None
    assert preprocessor.repeats
