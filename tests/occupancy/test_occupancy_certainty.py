"""The probability that a free cell holds an obstacle, and how it travels in maps."""

from dataclasses import replace

import numpy as np
import pytest

from vsx_ros.errors import MapFileError
from vsx_ros.io.map_file import load_map, save_map
from vsx_ros.occupancy.certainty import TERMS, Evidence, obstacle_probability
from vsx_ros.occupancy.grid import FREE, MOST_FREE_PERCENT, OCCUPIED, UNKNOWN, OccupancyGrid

SHAPE = 30, 40


def evidence(votes=5, hits=0, driven=False):
    """The same evidence in each cell."""
    return Evidence(np.full(SHAPE, votes, np.int32), np.full(SHAPE, hits, np.int32), np.full(SHAPE, driven))


def room():
    """Free ground with a wall on its left and unknown ground on its right."""
    data = np.full(SHAPE, FREE, np.int8)
    data[:, 0], data[:, -1] = OCCUPIED, UNKNOWN
    return data


def test_every_level_of_a_term_has_log_odds():
    for term in TERMS.values():
        assert len(term.log_odds) == len(term.uppers) + 1
        assert list(term.uppers) == sorted(set(term.uppers))
        assert term.level(np.array([-1.0, term.uppers[0], term.uppers[-1] + 1.0])).tolist() == [0, 0, len(term.uppers)]


def test_only_free_cells_are_in_doubt():
    data = room()
    told = obstacle_probability(data, evidence())
    assert (told[data == OCCUPIED] == 1.0).all()
    assert np.isnan(told[data == UNKNOWN]).all()
    assert ((told[data == FREE] > 0.0) & (told[data == FREE] < 0.9)).all()


def test_more_looks_and_the_drive_make_a_cell_surer_and_hits_less_sure():
    data, middle = room(), (15, 20)
    few, many = (obstacle_probability(data, evidence(votes))[middle] for votes in (1, 30))
    assert 0.0 < many < 0.7 * few
    assert obstacle_probability(data, evidence(driven=True))[middle] < obstacle_probability(data, evidence())[middle]
    assert obstacle_probability(data, evidence(hits=1))[middle] > obstacle_probability(data, evidence())[middle]


def test_cells_beside_a_wall_are_less_sure():
    told = obstacle_probability(room(), evidence())
    assert told[15, 1] > 3.0 * told[15, 12]
    assert np.allclose(told[10, :-1], told[20, :-1])


def test_without_obstacles_and_without_free_cells_there_is_an_answer():
    assert np.isfinite(obstacle_probability(np.full(SHAPE, FREE, np.int8), evidence())).all()
    assert np.isnan(obstacle_probability(np.full(SHAPE, UNKNOWN, np.int8), evidence())).all()


def test_percentages_keep_every_cell_on_its_side_of_the_thresholds(tmp_path):
    data = room()
    told = np.tile(np.linspace(0.0, 0.6, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    grid = OccupancyGrid(data, 0.05, -1.0, 2.0, told)
    percent = grid.percent()
    assert (percent[data == OCCUPIED] == 100).all()
    assert (percent[data == UNKNOWN] == -1).all()
    assert percent[data == FREE].min() >= 0
    assert percent[data == FREE].max() == MOST_FREE_PERCENT
    assert abs(percent[0, 5] - 100.0 * told[0, 5]) <= 0.5
    save_map(grid, tmp_path / "map")
    assert np.array_equal(load_map(tmp_path / "map.yaml").data, data)
    plain = replace(grid, probability=None)
    assert np.array_equal(plain.percent(), data)


def test_the_image_holds_the_probability(tmp_path):
    told = np.tile(np.linspace(0.0, 0.18, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    grid = OccupancyGrid(np.full(SHAPE, FREE, np.int8), 0.05, 0.0, 0.0, told)
    save_map(grid, tmp_path / "map")
    pixels = np.frombuffer((tmp_path / "map.pgm").read_bytes()[-told.size :], np.uint8).reshape(SHAPE)[::-1]
    assert np.abs((255 - pixels.astype(float)) / 255.0 - told).max() < 0.5 / 255 + 4e-3


def test_probabilities_of_another_size_are_refused():
    with pytest.raises(MapFileError, match="probability of each"):
        OccupancyGrid(room(), 0.05, 0.0, 0.0, np.zeros((2, 2), np.float32))
