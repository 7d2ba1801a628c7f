"""A 6 m x 4 m room with a box, and maps of it that are wrong in known ways."""

import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.evaluation.map_quality import map_quality, observable_cells, viewing_cells
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def seen_from(truth, start):
    return observable_cells(truth, viewing_cells(truth, start, 0.18), 4.0)


@pytest.fixture
def truth():
    data = np.full((100, 140), UNKNOWN, np.int8)
    data[8:92, 8:132] = OCCUPIED
    data[10:90, 10:130] = FREE
    data[40:60, 60:80] = OCCUPIED
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


@pytest.fixture
def observable(truth):
    return seen_from(truth, SE2(1.0, 1.0, 0.0))


def edited(truth, rows, columns, value):
    data = truth.data.copy()
    data[rows, columns] = value
    return OccupancyGrid(data, truth.resolution, truth.origin_x, truth.origin_y)


def test_what_is_in_sight(truth, observable):
    assert observable[10:90, 10:130][truth.data[10:90, 10:130] == FREE].all()
    assert observable[9, 10:130].mean() > 0.95
    assert observable[40:60, 60].all()
    assert not observable[42:58, 62:78].any()
    assert not observable[:8].any()


def test_a_room_behind_a_wall_is_not_observable(truth):
    divided = edited(truth, slice(None), slice(95, 97), OCCUPIED)
    seen = seen_from(divided, SE2(1.0, 1.0, 0.0))
    assert seen[50, 90]
    assert not seen[:, 100:].any()


def test_a_start_in_a_wall_is_refused(truth):
    for x, y in ((3.5, 2.5), (-5.0, 0.0), (0.55, 0.55)):
        with pytest.raises(InputError, match="not free"):
            viewing_cells(truth, SE2(x, y, 0.0), 0.18)


def test_the_truth_is_perfect(truth, observable):
    quality = map_quality(truth, truth, observable, SE2())
    assert (quality.coverage, quality.coverage_correct) == (1.0, 1.0)
    assert (quality.occupied_precision, quality.occupied_recall, quality.free_inside_obstacle) == (1.0, 1.0, 0.0)


def test_an_empty_map_covers_nothing(truth, observable):
    quality = map_quality(edited(truth, slice(None), slice(None), UNKNOWN), truth, observable, SE2())
    assert (quality.coverage, quality.occupied_recall) == (0.0, 0.0)
    assert quality.occupied_precision is None
    assert quality.free_inside_obstacle is None


def test_half_a_map_covers_half(truth, observable):
    quality = map_quality(edited(truth, slice(None), slice(70, None), UNKNOWN), truth, observable, SE2())
    assert quality.coverage == pytest.approx(0.5, abs=0.02)
    assert quality.coverage_correct == quality.coverage


def test_wrong_cells_cover_but_are_not_correct(truth, observable):
    quality = map_quality(edited(truth, slice(70, 80), slice(20, 120), OCCUPIED), truth, observable, SE2())
    wrong = 10 * 100 / observable.sum()
    assert quality.coverage == 1.0
    assert 1 - quality.coverage_correct == pytest.approx(wrong, rel=0.01)
    assert quality.occupied_precision < 0.7


def test_free_cells_deep_inside_an_obstacle_are_counted(truth, observable):
    quality = map_quality(edited(truth, slice(40, 60), slice(60, 80), FREE), truth, observable, SE2())
    free = (truth.data == FREE).sum() + 400
    assert 12**2 <= quality.free_inside_obstacle * free <= 17**2
    assert quality.occupied_recall < 0.95


def test_a_wall_within_ten_centimetres_is_right(truth, observable):
    data = np.roll(truth.data, 2, axis=1)
    near = map_quality(OccupancyGrid(data, 0.05, 0.0, 0.0), truth, observable, SE2())
    far = map_quality(OccupancyGrid(np.roll(data, 4, axis=1), 0.05, 0.0, 0.0), truth, observable, SE2())
    assert near.occupied_precision == 1.0
    assert near.occupied_recall > 0.99
    assert far.occupied_precision < 0.9


def test_maps_begin_where_the_robot_began(truth, observable):
    start = SE2(1.0, 1.0, 0.6)
    centres_map = start.inverse() @ truth.centres(np.argwhere(np.ones(truth.shape, bool)))
    low = np.floor(centres_map.min(axis=0) / 0.025) * 0.025
    shape = tuple(np.ceil((centres_map.max(axis=0) - low) / 0.025).astype(int)[::-1] + 1)
    blank = OccupancyGrid(np.full(shape, UNKNOWN, np.int8), 0.025, *low)
    cells = truth.cells(start @ blank.centres(np.argwhere(blank.data == UNKNOWN)))
    inside = truth.contains(cells)
    values = np.where(inside, truth.data[tuple(np.clip(cells, 0, np.array(truth.shape) - 1).T)], UNKNOWN)
    turned = OccupancyGrid(values.reshape(shape), 0.025, *low)
    quality = map_quality(turned, truth, observable, start)
    assert quality.coverage > 0.999
    assert quality.coverage_correct > 0.999
    assert quality.occupied_precision == 1.0
