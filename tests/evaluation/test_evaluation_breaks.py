import numpy as np
import pytest

from vsx_ros.evaluation.breaks import continuity
from vsx_ros.geometry.se3 import SE3, so3_exp
from vsx_ros.slam.state import TrackingResult, TrackingState

GOOD, LOST, BEFORE = TrackingState.GOOD, TrackingState.LOST, TrackingState.NOT_INITIALISED


def drive(n=20):
    return [SE3(so3_exp(np.array([0, 0, 0.02 * i])), np.array([0.05 * i, 0, 0])) for i in range(n)]


def results(poses, states):
    return [TrackingResult(i * 10**8, s, p, 100, 80, False, s.value) for i, (p, s) in enumerate(zip(poses, states))]


def shifted(poses, start, metres=0.0, degrees=0.0):
    jump = SE3(so3_exp(np.array([0, 0, np.deg2rad(degrees)])), np.array([metres, 0, 0]))
    return [p @ jump if i >= start else p for i, p in enumerate(poses)]


def find_breaks(told, reference):
    return continuity(told, reference).breaks


def find_odometry_jumps(told, reference):
    return continuity(told, reference).odometry_jumps


def test_a_faithful_run_has_no_break():
    moved = [SE3.exp(np.array([3.0, 1, 0, 0, 0, 1.0])) @ p for p in drive()]
    assert find_breaks(results(moved, [GOOD] * 20), drive()) == []


@pytest.mark.parametrize(("metres", "degrees", "count"), [(0.14, 0, 0), (0.16, 0, 1), (0, 4.9, 0), (0, 5.1, 1)])
def test_jumps_are_counted_from_the_promised_size(metres, degrees, count):
    found = find_breaks(results(shifted(drive(), 10, metres, degrees), [GOOD] * 20), drive())
    assert [b.stamp_ns for b in found] == [10 * 10**8] * count


@pytest.mark.parametrize("degrees", [80.0, 120.0, 170.0, -170.0])
def test_turns_of_any_size_are_told_and_those_of_both_are_none(degrees):
    turned = shifted(drive(), 10, 0.0, degrees)
    (found,) = find_breaks(results(turned, [GOOD] * 20), drive())
    assert f"{abs(degrees):.1f} deg" in found.reason
    assert find_breaks(results(turned, [GOOD] * 20), turned) == []


def test_where_odometry_leaves_its_course_and_the_image_does_not_odometry_jumped():
    told = results(drive(), [GOOD] * 20)
    for metres, degrees in ((0.3, 0.0), (0.0, 12.0)):
        reference = shifted(drive(), 10, metres, degrees)
        assert find_breaks(told, reference) == []
        jumps = find_odometry_jumps(told, reference)
        assert [(jump.stamp_ns, "odometry jumped" in jump.reason) for jump in jumps] == [(10 * 10**8, True)]
    assert find_odometry_jumps(results(shifted(drive(), 10, 0.3), [GOOD] * 20), drive()) == []


def test_a_drone_that_banks_does_not_jump_against_odometry_which_knows_no_tilt():
    bank = SE3(so3_exp(np.array([np.deg2rad(9.0), 0, 0])), np.zeros(3))
    told = results([p @ bank if i == 10 else p for i, p in enumerate(drive())], [GOOD] * 20)
    assert find_breaks(told, drive()) == find_odometry_jumps(told, drive()) == []


def test_a_jump_of_the_map_itself_is_no_break():
    told = results(shifted(drive(), 10, 0.5), [GOOD] * 20)
    told[10] = told[10]._replace(corrected=True)
    assert find_breaks(told, drive()) == []


def test_relocalising_at_the_right_place_is_no_break():
    states = [GOOD] * 5 + [LOST] * 5 + [GOOD] * 10
    assert find_breaks(results(drive(), states), drive()) == []
    wrong = find_breaks(results(shifted(drive(), 10, 0.3), states), drive())
    assert [b.stamp_ns for b in wrong] == [10 * 10**8]


def test_lost_for_good_is_one_break_where_it_began():
    states = [GOOD] * 5 + [LOST] * 2 + [GOOD] * 5 + [LOST] * 8
    found = find_breaks(results(drive(), states), drive())
    assert [(b.stamp_ns, "for good" in b.reason) for b in found] == [(12 * 10**8, True)]


def test_a_map_that_was_given_up_and_not_begun_again_is_lost_for_good():
    found = find_breaks(results(drive(), [BEFORE] * 2 + [GOOD] * 5 + [LOST] * 3 + [BEFORE] * 10), drive())
    assert [(b.stamp_ns, "for good" in b.reason) for b in found] == [(7 * 10**8, True)]
    assert find_breaks(results(drive(), [GOOD] * 5 + [BEFORE] * 5 + [GOOD] * 10), drive()) == []


def test_never_started_is_no_break():
    assert find_breaks(results([None] * 4, [BEFORE] * 4), drive(4)) == []
    assert find_breaks([], []) == []


def test_without_a_reference_only_the_loss_counts():
    states = [GOOD] * 19 + [LOST]
    assert len(find_breaks(results(shifted(drive(), 10, 1.0), states), [None] * 20)) == 1
