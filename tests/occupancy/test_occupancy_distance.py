"""Distances against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.occupancy.distance import clearance_field, travel_distance, with_fringe
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


@given(st.integers(1, 14), st.integers(1, 14), st.integers(0, 10**6))
@settings(max_examples=60)
def test_clearance_is_the_distance_to_the_nearest_square_that_is_not_free(rows, columns, seed):
    rng = np.random.default_rng(seed)
    data = rng.choice(np.array([FREE, FREE, FREE, OCCUPIED, UNKNOWN], np.int8), (rows, columns))
    field = clearance_field(OccupancyGrid(data, 0.1, 2.0, -1.0), reach_m=0.5)
    blocked = np.ones((rows + 2, columns + 2), bool)
    blocked[1:-1, 1:-1] = data != FREE
    for i in range(rows + 2):
        for j in range(columns + 2):
            others = np.argwhere(blocked != blocked[i, j])
            if len(others) == 0:
                continue
            d = np.maximum(np.abs(others - (i, j)) - 0.5, 0.0)
            nearest = min(0.1 * np.hypot(d[:, 0], d[:, 1]).min(), 0.5)
            expected = -nearest if blocked[i, j] else nearest
            assert field.values[i, j] == pytest.approx(expected, abs=1e-12)


def test_interpolation_gradient_and_outside():
    data = np.zeros((40, 40), np.int8)
    data[:, :10] = OCCUPIED
    field = clearance_field(OccupancyGrid(data, 0.05, 0.0, 0.0))
    points = np.array([[0.7, 1.0], [0.75, 1.01]])
    assert field.at(points) == pytest.approx([0.2, 0.25], abs=1e-9)
    assert field.gradient(points) == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0]]), abs=1e-9)
    assert field.at(np.array([[1.0, -5.0]]))[0] == pytest.approx(-5.0, abs=0.1)


def test_travel_distance_goes_around():
    values = np.ones((20, 20))
    values[0:15, 10] = -1.0
    field = DistanceField(values, 0.1, 0.0, 0.0)
    d = travel_distance(field, (0.55, 0.55))
    assert d[5, 5] == 0.0
    assert d[5, 8] == pytest.approx(0.3)
    assert np.isinf(d[5, 10])
    # Down past the wall's end and up again: two legs of 5 columns and 10 rows, diagonals counted as such.
    assert 2.0 < d[5, 15] < 2.9
    assert np.all(np.isinf(travel_distance(field, (9.0, 9.0))))


def test_the_fringe_is_one_cell_deep():
    values = np.ones((9, 9))
    values[:, 4:7] = -1.0
    field = DistanceField(values, 0.1, 0.0, 0.0)
    d = with_fringe(travel_distance(field, (0.05, 0.45)), 0.1)
    assert d[4, 3] == pytest.approx(0.3)
    assert d[4, 4] == pytest.approx(0.4)
    assert np.isinf(d[4, 5])
    assert np.isinf(d[4, 8])
