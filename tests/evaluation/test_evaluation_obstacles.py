"""Sparse and dense maps are judged by the faces that were seen."""

import re

import numpy as np
import pytest

from vsx_ros.evaluation.map_quality import (
    map_on_truth_picture,
    narrow_gaps,
    obstacle_quality,
    seen_faces,
    truth_picture,
)
from vsx_ros.evaluation.page import page as page_of
from vsx_ros.experiments.ground_maps import maps_beside_truth
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

RES = 0.05
START = SE2(2.0, 1.5, 0.0)


def room():
    """5 m x 3 m, walls two cells thick."""
    data = np.full((60, 100), OCCUPIED, np.int8)
    data[2:-2, 2:-2] = FREE
    return OccupancyGrid(data, RES, 0.0, 0.0)


TRUTH = room()
CAMERAS = [SE3.from_se2(SE2(2.0 + 0.1 * k, 1.5, 0.0)) @ mount_pose(0.0, 0.0, 0.3, 0.0) for k in range(4)]
FACES = seen_faces(TRUTH, CAMERAS)


def shifted(data):
    """A map in its own frame, whose origin is at the start."""
    return OccupancyGrid(data, RES, -START.x, -START.y)


def test_faces_ahead_within_the_view_were_seen_and_no_others():
    cells = np.argwhere(FACES)
    assert set(cells[:, 1]) == {98}
    y = (cells[:, 0] + 0.5) * RES
    assert y.min() == pytest.approx(1.5 - 2.75 * np.tan(0.45), abs=0.15)
    assert y.max() == pytest.approx(1.5 + 2.75 * np.tan(0.45), abs=0.15)
    assert not seen_faces(TRUTH, CAMERAS[:2]).any()


def test_the_truth_itself_is_perfect():
    quality = obstacle_quality(shifted(TRUTH.data), TRUTH, FACES, START)
    assert (quality.precision, quality.recall, quality.f1) == (1.0, 1.0, 1.0)
    assert (quality.surface_free, quality.free_inside, quality.phantom_m2) == (0.0, 0.0, 0.0)


def test_gaps_phantoms_and_lies_are_counted():
    data = TRUTH.data.copy()
    data[10:14, 40:50] = OCCUPIED
    data[30:, 95:] = FREE
    quality = obstacle_quality(shifted(data), TRUTH, FACES, START)
    assert quality.phantom_m2 == pytest.approx(40 * RES**2)
    below = (np.argwhere(FACES)[:, 0] < 30).mean()
    assert quality.recall == pytest.approx(below, abs=0.1)
    assert quality.surface_free == pytest.approx(1.0 - below, abs=0.02)
    assert 0.9 < quality.precision < 1.0
    assert quality.f1 == pytest.approx(2 * quality.precision * quality.recall / (quality.precision + quality.recall))


def test_gaps_of_the_width_of_a_robot_are_looked_at_and_no_others():
    data = TRUTH.data.copy()
    for left, right in ((2, 40), (52, 70), (74, 98)):
        data[24:36, left:right] = OCCUPIED
    truth = OccupancyGrid(data, RES, 0.0, 0.0)
    gaps = narrow_gaps(truth)
    # One is 0.6 m wide, one 0.2 m; to the walls of the room it is 1.1 m.
    assert gaps[29:31, 44:48].all()
    assert np.argwhere(gaps)[:, 1].min() >= 40
    assert np.argwhere(gaps)[:, 1].max() < 52
    filled = data.copy()
    filled[24:36, 40:46] = OCCUPIED
    assert obstacle_quality(shifted(data), truth, FACES, START).gaps_free == 1.0
    assert obstacle_quality(shifted(filled), truth, FACES, START).gaps_free < 0.8


def test_nothing_known_is_judged_by_what_is_missing():
    quality = obstacle_quality(shifted(np.full(TRUTH.shape, UNKNOWN, np.int8)), TRUTH, FACES, START)
    assert (quality.precision, quality.recall, quality.f1, quality.phantom_m2) == (None, 0.0, None, 0.0)


def test_the_page_shows_each_map_and_says_what_is_unknown():
    empty = shifted(np.full(TRUTH.shape, UNKNOWN, np.int8))
    grids = {"sparse": empty, "dense": shifted(TRUTH.data)}
    section, numbers = maps_beside_truth(TRUTH, FACES, grids, START, "a <room>")
    page = page_of("Figure 5", "", [section])
    assert numbers["dense"]["f1"] == pytest.approx(1.0, abs=1e-3)
    assert page.count("<img") == 3
    assert "a &lt;room&gt;" in page
    assert "<td>unknown</td><td>1.000</td>" in page
    assert not re.search(r'(src|href)="(?!data:)|url\(|<script', page)


BLACK, RED, ORANGE, WHITE = "found", "phantom", "missed", "free"


def colour(pixel: np.ndarray) -> str:
    blue, green, red = (int(value) for value in pixel)
    if max(blue, green, red) < 80:
        return BLACK
    if min(blue, green, red) > 240:
        return WHITE
    return RED if green < 100 else ORANGE


def test_a_map_is_black_where_it_is_right_red_where_it_errs_and_orange_where_it_lacks_a_face():
    data = np.full((40, 60), FREE, np.int8)
    data[0, :] = data[-1, :] = OCCUPIED
    truth, faces = OccupancyGrid(data, 0.05, 0.0, 0.0), data == OCCUPIED
    seen = np.full((40, 60), UNKNOWN, np.int8)
    seen[0, :] = seen[20, 30] = OCCUPIED
    seen[1:20] = FREE
    image = map_on_truth_picture(OccupancyGrid(seen, 0.05, -2.0, 0.0), truth, faces, SE2(2.0, 0.0, 0.0))
    assert image.shape == (40, 60, 3)
    assert colour(image[-1, 5]) == BLACK  # north up: the southern wall is the last row
    assert colour(image[0, 5]) == ORANGE
    assert colour(image[39 - 20, 30]) == RED
    assert colour(image[39 - 10, 5]) == WHITE
    assert colour(truth_picture(truth, faces)[0, 5]) == BLACK
