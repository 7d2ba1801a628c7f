"""Who holds the wheels, from what the base decides."""

from vsx_ros.control.operator_hold import OperatorHoldWatch
from vsx_ros.robot import EMERGENCY_STOP, OperatorHold

SECOND = 1_000_000_000


def test_navigation_holds_nothing():
    watch = OperatorHoldWatch(3.0)
    assert watch.observe(0, False, "navi") is None
    assert watch.observe(1, False, "") is None


def test_an_emergency_stop_holds_until_it_is_released_and_not_longer():
    watch = OperatorHoldWatch(3.0)
    assert [watch.observe(k * SECOND, True, "navi") for k in range(300)] == [OperatorHold(EMERGENCY_STOP, 0)] * 300
    assert watch.observe(300 * SECOND, False, "navi") is None


def test_teleop_holds_between_its_keys_and_a_moment_longer():
    watch = OperatorHoldWatch(3.0)
    assert watch.observe(5 * SECOND, False, "teleop") == OperatorHold("teleop", 5 * SECOND)
    assert watch.observe(7 * SECOND, False, "navi") == OperatorHold("teleop", 5 * SECOND)
    assert watch.observe(7 * SECOND, False, "teleop") == OperatorHold("teleop", 5 * SECOND)
    assert watch.observe(10 * SECOND, False, "navi") is not None
    assert watch.observe(10 * SECOND + 1, False, "navi") is None


def test_a_stop_pressed_while_driving_by_hand_counts_from_then():
    watch = OperatorHoldWatch(3.0)
    watch.observe(SECOND, False, "teleop")
    assert watch.observe(2 * SECOND, True, "teleop") == OperatorHold(EMERGENCY_STOP, 2 * SECOND)
    assert watch.observe(3 * SECOND, False, "teleop") == OperatorHold("teleop", 3 * SECOND)


def test_the_words_say_what_ends_it():
    assert "release" in OperatorHold(EMERGENCY_STOP, 0).words()
    assert "by itself" in OperatorHold("teleop", 0).words()
