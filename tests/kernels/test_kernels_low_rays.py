"""Where rays of a high camera are low, against rows of small cells."""

import numpy as np
import pytest

from vsx_ros.kernels.occupancy.low_rays import add_last, join_stretches, low_begin

CELL_M, CELLS = 1 / 16, 128  # all stretches end between cells


def covered(stretches):
    """(CELLS,) the cells on any of the stretches (N, 2)."""
    middles = (np.arange(CELLS) + 0.5) * CELL_M
    return ((stretches[:, :1] < middles) & (middles < stretches[:, 1:])).any(axis=0)


def runs(cells):
    """(N, 2) from and to of the covered runs of cells, nearest first."""
    edges = np.diff(np.concatenate([[0], cells.astype(int), [0]]))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)]) * CELL_M


def random_stretches(rng, n):
    """(n, 2) of a camera at 1 m or lower, a few of them empty."""
    end = rng.integers(8, CELLS, n)
    begin = np.maximum(1, (end * rng.uniform(0.5, 1.05, n)).astype(int))
    return (np.column_stack([begin, end]) * CELL_M).astype(np.float32)


def in_bin(stretches, scans=3, bins=4, k=2, b=1):
    """begin, free, farther of scans in which one bin has these stretches."""
    begin, free, farther = (np.zeros((scans, bins, *more), np.float32) for more in ((), (), (2,)))
    keyframe, bearing = np.full(len(stretches), k, np.int32), np.full(len(stretches), b, np.int32)
    join_stretches(stretches, keyframe, bearing, begin, free, farther)
    return begin, free, farther


def test_a_ray_is_low_from_where_it_comes_down():
    assert low_begin(4.0, 0.0, 1.0, 0.42) == pytest.approx(4.0 * 0.58)
    assert low_begin(4.0, 0.21, 0.84, 0.42) == pytest.approx(4.0 * 2 / 3)
    assert low_begin(4.0, 0.42, 1.0, 0.42) == np.inf
    assert low_begin(4.0, 0.9, 0.42, 0.42) == 0.0


def test_overlapping_stretches_are_one_and_others_stay_apart_in_any_order():
    rng, separate = np.random.default_rng(1), []
    for _ in range(300):
        stretches = random_stretches(rng, rng.integers(1, 7))
        expected = runs(covered(stretches))
        separate.append(len(expected))
        near, far = [*expected, np.zeros(2), np.zeros(2)][:2]
        for order in (np.arange(len(stretches)), rng.permutation(len(stretches))):
            begin, free, farther = in_bin(stretches[order])
            assert (begin[2, 1], free[2, 1]) == tuple(near)
            assert np.array_equal(farther[2, 1], far)
            assert not free[:2].any()
            assert not farther[:2].any()
    assert set(separate) >= {0, 1, 2, 3}


def test_the_last_stretch_joins_those_that_it_overlaps():
    rng, apart = np.random.default_rng(2), 0
    for _ in range(300):
        stretches = random_stretches(rng, rng.integers(0, 4)).reshape(-1, 2)
        end = np.float32(stretches.max(initial=0.5) + rng.integers(1, 16) * CELL_M)
        last = np.array([[end * rng.choice([0.5, 0.75, 0.875, 1.0]), end]], np.float32).round(4)
        last[0, 0] -= last[0, 0] % np.float32(CELL_M)
        begin, free, farther = in_bin(stretches)
        kept = np.vstack([[begin[2, 1], free[2, 1]], farther[2, 1]])
        add_last(last[0, 0], last[0, 1], 2, 1, begin, free, farther)
        expected = covered(np.vstack([kept, last]))
        if len(runs(expected)) > 2:
            expected, apart = covered(kept), apart + 1
        assert np.array_equal(covered(np.vstack([[begin[2, 1], free[2, 1]], farther[2, 1]])), expected)
    assert 5 < apart < 100


def test_a_stretch_cut_away_leaves_its_place_to_the_last_one():
    begin, free, farther = in_bin(np.array([[2.0, 3.0], [4.0, 5.0]], np.float32))
    free[2, 1] = farther[2, 1, 1] = 1.5  # a surface stands there
    add_last(np.float32(1.0), np.float32(1.5), 2, 1, begin, free, farther)
    assert (begin[2, 1], free[2, 1]) == (1.0, 1.5)
    assert farther[2, 1, 1] < farther[2, 1, 0]
