"""Intervals and tests against textbook values."""

import numpy as np
import pytest

from vsx_ros.evaluation.page import interval
from vsx_ros.evaluation.paired import group_means, mean_interval, ratio_interval, share_interval, sign_test


def test_the_mean_of_many_has_the_interval_of_the_normal_law():
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    interval = mean_interval(values.tolist())
    half = 1.96 * values.std() / 20
    assert interval.value == pytest.approx(values.mean())
    assert interval.low == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert interval.high == pytest.approx(values.mean() + half, abs=0.15 * half)
    assert mean_interval([3.0, 3.0]) == (3.0, 3.0, 3.0)


def test_runs_in_one_world_count_once():
    worlds = [("lab", 7), ("lab", 8), ("lab", 7), ("lab", 7)]
    assert group_means(worlds, [1.0, 5.0, 2.0, 6.0]) == [3.0, 5.0]
    assert group_means([], []) == []


def test_pairs_are_drawn_together():
    below = np.random.default_rng(2).uniform(1.0, 100.0, 50)
    assert ratio_interval((3 * below).tolist(), below.tolist()) == pytest.approx((3.0, 3.0, 3.0))
    assert ratio_interval([4.0, 6.0], [1.0, 4.0]).value == pytest.approx(2.0)


def test_a_share_of_none_still_leaves_room():
    """Wilson's interval; 0 of 60 proves less than 6 %."""
    none = share_interval(0, 60)
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(0.0602, abs=2e-4)
    half = share_interval(10, 20)
    assert share_interval(1.5, 3).value == 0.5
    assert (half.low, half.high) == (pytest.approx(0.2993, abs=2e-4), pytest.approx(0.7007, abs=2e-4))


def test_the_sign_test_is_the_binomial_one():
    assert sign_test([1, 2, 3, 4, 5, 6], [0] * 6) == pytest.approx(2 / 64)
    assert sign_test([1, 0], [0, 1]) == 1.0
    assert sign_test([1, 1, 1], [1, 1, 1]) == 1.0
    assert sign_test([1] * 9 + [0], [0] * 9 + [1]) == pytest.approx(2 * 11 / 1024)


def test_nothing_proves_nothing():
    assert mean_interval([]) is ratio_interval([], []) is share_interval(0, 0) is None


def test_nothing_divides_nothing():
    assert ratio_interval([1.0, 2.0], [0.0, 0.0]) is None
    assert ratio_interval([1.0, 1.0, 1.0], [0.0, 1.0, 0.0]) == (3.0, 1.0, None), "draws without the one are infinite"


@pytest.mark.parametrize("n", [2, 3, 4, 8, 10, 19])
def test_intervals_of_few_values_hold_the_mean_as_often_as_they_say(n):
    drawn = np.random.default_rng(1).normal(10.0, 1.0, (600, n))
    intervals = [mean_interval(values.tolist()) for values in drawn]
    assert np.mean([interval.low <= 10.0 <= interval.high for interval in intervals]) >= 0.92


def test_one_value_has_no_bounds():
    assert mean_interval([0.95]) == (0.95, None, None)
    assert ratio_interval([3.0], [2.0]) == (1.5, None, None)
    assert interval(mean_interval([0.95])) == "0.95 [unknown, unknown]"
    assert interval(ratio_interval([1.0, 1.0, 1.0], [0.0, 1.0, 0.0])) == "3.00 [1.00, unknown]"
