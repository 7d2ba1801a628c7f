"""A base whose wheels turn while the camera stands is told from one that moves, slips a little or stands."""

import math

import pytest

from vsx_ros.control.stuck import StuckDetector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

STEP_M = 0.01
START = SE2(2.0, -1.0, 0.7)


def drive(
    watch: StuckDetector, counted: SE2, seen: SE2, steps: int, way_m: float, seen_share: float, every_ns: int = 0
) -> tuple[SE2, SE2]:
    """So many steps of way_m by odometry, of which the camera sees a share; where the base is by either."""
    for k in range(steps):
        counted, seen = counted @ SE2(way_m, 0.0, 0.0), seen @ SE2(seen_share * way_m, 0.0, 0.0)
        watch.add(Odometry((k + 1) * every_ns, counted), seen)
    return counted, seen


@pytest.mark.parametrize("way_m", [STEP_M, -STEP_M])
def test_turning_wheels_of_a_standing_base_are_noticed_within_centimetres(way_m: float):
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 30, way_m, 1.0)
    assert watch.stuck is None
    counted, seen = drive(watch, counted, seen, 3, way_m, 0.0)
    assert watch.stuck is None
    drive(watch, counted, seen, 3, way_m, 0.0)
    assert watch.stuck is not None
    assert watch.stuck.T_world_push.distance_to(seen) < 1e-9
    push = watch.stuck.T_world_push.theta - seen.theta
    assert math.cos(push) == pytest.approx(math.copysign(1.0, way_m))
    assert ("ahead" if way_m > 0 else "back") in watch.stuck.reason


@pytest.mark.parametrize("put", [SE2(0.12, 0.0, 0.0), SE2(0.0, 3.0, 1.0)])
def test_it_ends_when_somebody_moves_the_base_and_is_judged_anew(put: SE2):
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 10, STEP_M, 0.0)
    watch.add(Odometry(0, counted), seen @ SE2(0.03, 0.0, 0.0))
    assert watch.stuck is not None, "the camera is not as exact as that"
    watch.add(Odometry(0, counted), seen @ put)
    assert watch.stuck is None
    drive(watch, counted, seen @ put, 10, STEP_M, 0.0)
    assert watch.stuck is not None


def test_it_ends_when_the_base_is_lifted_or_put_down_where_it_was():
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 10, STEP_M, 0.0)
    watch.lifted()
    assert watch.stuck is None
    for _ in range(50):
        watch.add(Odometry(0, counted), seen)
    assert watch.stuck is None
    drive(watch, counted, seen, 10, STEP_M, 0.0)
    assert watch.stuck is not None


@pytest.mark.parametrize("images_hz", [30, 10, 6, 3])
def test_a_slow_computer_notices_it_in_few_images(images_hz: int):
    watch, every_ns, way_m = StuckDetector(), 10**9 // images_hz, 0.2 / images_hz  # at 0.2 m/s
    counted, seen = drive(watch, SE2(), START, 20, way_m, 1.0, every_ns)
    assert watch.stuck is None
    counted, seen = drive(watch, counted, seen, 9, way_m, 0.0, every_ns)
    assert watch.stuck is not None
    drive(watch, counted, seen, 10, way_m, 1.0, every_ns)
    assert watch.stuck is None


def test_it_holds_while_the_base_stands_and_ends_when_it_is_seen_to_move():
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 10, -STEP_M, 0.0)
    for _ in range(200):
        watch.add(Odometry(0, counted), seen)
    assert watch.stuck is not None
    drive(watch, counted, seen, 7, STEP_M, 1.0)
    assert watch.stuck is None


def test_once_it_is_free_the_way_it_was_stuck_on_counts_no_more():
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 8, STEP_M, 0.0)
    said = watch.stuck
    for _ in range(20):
        counted, seen = drive(watch, counted, seen, 1, STEP_M, 1.0)
        assert watch.stuck in (said, None)
    assert watch.stuck is None


@pytest.mark.parametrize("share", [0.5, 0.9, 1.5])
def test_wheels_that_slip_or_are_pushed_are_not_stuck(share: float):
    watch = StuckDetector()
    drive(watch, SE2(), START, 60, STEP_M, share)
    assert watch.stuck is None


def test_a_map_that_moves_under_the_base_is_no_obstacle():
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 20, STEP_M, 1.0)
    for k in range(12):
        counted, seen = drive(watch, counted, seen, 1, STEP_M, 1.0)
        seen = seen @ SE2(-0.05 if k == 4 else 0.0, 0.0, 0.0)
        assert watch.stuck is None


def test_a_way_that_the_camera_did_not_see_judges_nobody():
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(), START, 20, STEP_M, 1.0)
    drive(watch, counted @ SE2(0.3, 0.0, 0.0), seen, 1, STEP_M, 0.0)
    assert watch.stuck is None


@pytest.mark.parametrize("jump", [SE2(-5.0, -3.0, 1.0), SE2(0.07, 0.0, 0.0), SE2(0.05, 0.0, 0.0)])
def test_wheels_that_jump_are_not_stuck(jump: SE2):
    watch = StuckDetector()
    counted, seen = drive(watch, SE2(5.0, 3.0, 0.0), START, 20, STEP_M, 1.0)
    counted = counted @ jump
    for _ in range(20):
        counted, seen = drive(watch, counted, seen, 1, 0.6 * STEP_M, 1.0)
        assert watch.stuck is None
    drive(watch, counted, seen, 8, STEP_M, 0.0)
    assert watch.stuck is not None


def test_a_base_that_turns_on_the_spot_is_not_stuck():
    watch = StuckDetector()
    for k in range(100):
        turned = SE2(0.0, 0.0, 0.05 * k)
        watch.add(Odometry(0, turned), START @ turned)
    assert watch.stuck is None


def test_ways_of_two_epochs_are_not_added_up():
    watch, seen = StuckDetector(), START
    for k in range(40):  # each epoch alone is too short to be judged
        watch.add(Odometry(0, SE2(0.01 * k, 0.0, 0.0), odom_epoch=k // 5), seen)
        assert watch.stuck is None
