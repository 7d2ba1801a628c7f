"""Counting found points: what hides a point and what a blurred image says are no fault of the tracker."""

import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.slam.tracker import hidden
from vsx_ros.slam.tracking_record import TrackingRecord, is_hopeless


def track(found, searched, concealed=0, blurred=False, x=0.0):
    pose, rows = SE3(np.eye(3), np.array([x, 0.0, 0.0])), np.arange(found)
    every = np.arange(searched)
    return Track(
        pose,
        TrackingState.GOOD,
        rows,
        np.zeros((found, 2)),
        rows,
        every,
        np.eye(6),
        "",
        every[found : found + concealed],
        blurred,
    )


def test_points_behind_found_ones_are_hidden():
    uv = np.array([[100.0, 100.0], [103.0, 101.0], [103.0, 101.0], [300.0, 40.0], [104.0, 104.0]])
    depth = np.array([1.0, 2.0, 1.2, 5.0, 9.0])
    found = np.array([True, False, False, False, True])
    # Hidden: the second; the third is hardly behind, the fourth stands alone, the last is found.
    assert hidden(uv, depth, found).tolist() == [False, True, False, False, False]
    assert not hidden(uv, depth, np.zeros(5, bool)).any()
    assert hidden(np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool)).shape == (0,)


def test_hidden_points_are_those_behind_the_nearest_found_one_of_their_cell():
    rng = np.random.default_rng(3)
    uv, depth, found = rng.uniform(0.0, 80.0, (200, 2)), rng.uniform(1.0, 3.0, 200), rng.random(200) < 0.4
    cell = [tuple(at) for at in (uv // 16).astype(int).tolist()]
    expected = 0
    for s in np.flatnonzero(~found):
        before = [depth[o] for o in np.flatnonzero(found) if cell[o] == cell[s]]
        expected += bool(before) and depth[s] > 1.25 * min(before)
    assert 20 < expected < 120
    assert np.count_nonzero(hidden(uv, depth, found)) == expected


def test_visible_ratio_leaves_out_hidden_points_and_blurred_frames():
    record = TrackingRecord()
    record.initialised(0, np.zeros(3))
    record.tracked(10**9, track(40, 100, concealed=50), 100, True)
    record.tracked(2 * 10**9, track(10, 100, blurred=True), 100, True)
    record.tracked(3 * 10**9, track(60, 100), 100, True)
    statistics = record.statistics(2, 100)
    assert statistics.visible_ratio == pytest.approx((0.8 + 0.6) / 2)
    assert statistics.u1 == pytest.approx((0.4 + 0.1 + 0.6) / 3)


def test_a_blurred_frame_does_not_speak_against_a_point():
    record = TrackingRecord()
    record.initialised(0, np.zeros(3))
    record.tracked(1, track(40, 100), 100, True)
    record.tracked(2, track(10, 100, blurred=True), 100, True)
    searched, found = record.counts()
    assert searched[:10].tolist() == found[:10].tolist() == [2] * 10
    assert set(searched[10:]) == {1}
    assert found.sum() == 50


def test_neither_doubt_nor_what_hides_a_point_speaks_against_it():
    record = TrackingRecord()
    record.initialised(0, np.zeros(3))
    record.tracked(1, track(40, 100, concealed=30), 100, True)
    record.tracked(2, track(40, 100)._replace(state=TrackingState.DUBIOUS), 100, True)
    searched, found = record.counts()
    assert set(searched[:40]) == set(found[:40]) == {2}
    assert set(searched[40:70]) == {0}
    assert set(searched[70:]) == {1}


def test_points_looked_for_in_vain_are_hopeless():
    searched, found = np.array([4, 5, 5, 7, 8, 8, 100, 100]), np.array([0, 0, 1, 1, 1, 2, 24, 25])
    assert is_hopeless(searched, found).tolist() == [False, True, False, False, True, False, True, False]
    record = TrackingRecord()
    for k in range(1, 6):
        record.tracked(k, track(1, 2), 2, True)
    assert record.hopeless(np.arange(2)).tolist() == [False, True]
    assert record.hopeless(np.array([1])).tolist() == [True]


def test_lifetimes_in_frames_seconds_and_metres():
    record = TrackingRecord()
    record.initialised(0, np.zeros(3))
    for k in range(1, 5):
        record.tracked(k * 10**9, track(5 if k < 4 else 2, 5, x=0.1 * k), 5, True)
    statistics = record.statistics(2, 5)
    assert statistics.u2_frames == pytest.approx((2 * 4 + 3 * 3) / 5)
    assert statistics.u2_seconds == pytest.approx(statistics.u2_frames)
    assert statistics.u2_metres == pytest.approx(0.1 * statistics.u2_frames)
    record.missed(5 * 10**9)
    record.tracked(65 * 10**9, track(5, 5, x=5.0), 5, True)
    again = record.statistics(2, 5)
    assert (again.u2_seconds, again.u2_metres) == (statistics.u2_seconds, statistics.u2_metres), "lost time is nobody's"
    assert statistics.visible_ratio == pytest.approx((1 + 1 + 1 + 0.4) / 4)
