"""Frontiers and the ranking of views on grids whose answer is known."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from vsx_ros.arrays import array_bytes
from vsx_ros.config import Config
from vsx_ros.exploration.choice import Choice, chosen_in
from vsx_ros.exploration.decision import without_figures
from vsx_ros.exploration.utility import (
    BEARINGS,
    Ranking,
    RankingInput,
    Rejection,
    View,
    count_landmarks,
    gain_at,
    rank_views,
    traversable_cells,
    view_gain,
    window_sums,
)
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import with_view
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.unknown_ground import SECTORS, find_frontiers, looks_so_far, opaque_walls

CONFIG = with_view(Config()).exploration
NO_LANDMARKS_NEEDED = replace(CONFIG, min_landmarks=0)
RESOLUTION = 0.05
NOWHERE_YET = np.zeros((0, 3))


def ranked(*asked: object) -> Ranking:
    return rank_views(RankingInput(*asked))


def half_known_room() -> OccupancyGrid:
    """A 6 m x 4 m room with walls; x < 3 m is free, the rest unknown. Origin at the corner."""
    data = np.full((80, 120), UNKNOWN, np.int8)
    data[1:-1, 1:60] = FREE
    data[0, :] = data[-1, :] = data[:, 0] = data[:, -1] = OCCUPIED
    return OccupancyGrid(data, RESOLUTION, 0.0, 0.0)


def straight_costs(poses):
    """Distance from (1, 2), as if nothing were in the way."""
    return np.hypot(poses[:, 0] - 1.0, poses[:, 1] - 2.0)


def nowhere_avoided(poses):
    return np.zeros(len(poses), bool)


def test_the_border_to_the_unknown_is_one_frontier():
    frontiers = find_frontiers(half_known_room(), 0.25)
    assert len(frontiers) == 1
    assert frontiers[0].length_m == pytest.approx(78 * RESOLUTION)
    np.testing.assert_allclose(frontiers[0].centroid, [2.975, 2.0], atol=0.01)


def test_a_known_room_has_no_frontier():
    data = np.full((40, 40), OCCUPIED, np.int8)
    data[1:-1, 1:-1] = FREE
    assert find_frontiers(OccupancyGrid(data, RESOLUTION, 0, 0), 0.05) == []


def test_short_frontiers_are_left_out():
    assert find_frontiers(half_known_room(), 5.0) == []


def test_gain_is_the_unknown_area_inside_the_field_of_view():
    grid = half_known_room()
    gain = view_gain(grid, np.array([[2.5, 2.0]]), looks_so_far(grid, NOWHERE_YET, CONFIG), CONFIG)[0]
    # Looking along +x: a sector of the sensor's angle between the border (x = 3) and range or wall (x = 5.95).
    half = CONFIG.sensor_fov_rad / 2
    angles = np.linspace(-half, half, 2001)
    near = 0.5 / np.cos(angles)
    far = np.minimum(CONFIG.sensor_range_m, np.minimum(3.45 / np.cos(angles), 1.95 / np.abs(np.sin(angles) + 1e-12)))
    # What is r away counts by the chance that the s = r - near of unknown ground before it hide nothing.
    path_m = CONFIG.mean_free_path_m
    s = far - near
    shown = path_m * (near + path_m - (far + path_m) * np.exp(-s / path_m))
    expected = float(np.trapezoid(shown, angles))
    assert gain[0] == pytest.approx(expected, rel=0.06)
    assert gain[BEARINGS // 2] == 0.0


def test_window_sums_are_centred_and_cyclic():
    sums = window_sums(np.eye(1, 8, 0), 3)
    np.testing.assert_array_equal(sums, [[1, 1, 0, 0, 0, 0, 0, 1]])


def test_views_look_into_the_unknown_and_stand_on_free_ground():
    grid = half_known_room()
    ranking = ranked(grid, 0.2, np.zeros((0, 3)), NOWHERE_YET, straight_costs, nowhere_avoided, NO_LANDMARKS_NEEDED)
    # Without landmarks U is 0 for all; ask with plenty of them for the order.
    landmarks = np.random.default_rng(0).uniform([4.0, 0.5, 0.0], [5.5, 3.5, 1.0], (500, 3))
    ranking = ranked(grid, 0.2, landmarks, NOWHERE_YET, straight_costs, nowhere_avoided, CONFIG)
    best = ranking.views[0]
    assert abs(math.remainder(best.pose.theta, 2 * math.pi)) < math.radians(46)
    assert best.utility == pytest.approx(best.gain_m2 / (best.distance_m + CONFIG.stop_cost_m))
    assert [v.utility for v in ranking.views] == sorted((v.utility for v in ranking.views), reverse=True)
    room = traversable_cells(grid, 0.2)
    cells = grid.cells(np.array([[v.pose.x, v.pose.y] for v in ranking.views]))
    assert room[cells[:, 0], cells[:, 1]].all()


def test_few_landmarks_in_view_disqualify():
    grid = half_known_room()
    behind = np.tile([[0.2, 2.0, 0.5]], (500, 1))
    ranking = ranked(grid, 0.2, behind, NOWHERE_YET, straight_costs, nowhere_avoided, CONFIG)
    assert ranking.rejected[Rejection.FEW_LANDMARKS] > 0
    for view in ranking.views:
        assert view.landmarks >= CONFIG.min_landmarks


def test_what_is_far_for_the_little_it_shows_is_not_worth_the_way():
    grid = half_known_room()
    far = ranked(
        grid, 0.2, np.zeros((0, 3)), NOWHERE_YET, lambda p: np.full(len(p), 200.0), nowhere_avoided,
        NO_LANDMARKS_NEEDED,
    )  # fmt: skip
    assert far.views == []
    most = CONFIG.sensor_fov_rad / 2 * CONFIG.sensor_range_m**2
    assert most < CONFIG.min_utility_m * 200.0
    assert far.rejected[Rejection.NOT_WORTH] > 100
    assert far.rejected[Rejection.UNREACHABLE] == 0


def test_few_landmarks_are_better_than_none_where_no_view_has_enough():
    grid = half_known_room()
    some = np.tile([[4.5, 2.0, 0.5]], (CONFIG.min_landmarks // 2, 1))
    ranking = ranked(grid, 0.2, some, NOWHERE_YET, straight_costs, nowhere_avoided, CONFIG)
    assert {view.landmarks for view in ranking.views} == {CONFIG.min_landmarks // 2}
    assert ranking.rejected[Rejection.FEW_LANDMARKS] >= len(ranking.views)


def test_unreachable_and_blacklisted_views_are_counted_not_returned():
    grid = half_known_room()
    unreachable = ranked(
        grid,
        0.2,
        np.zeros((0, 3)),
        NOWHERE_YET,
        lambda p: np.full(len(p), np.inf),
        nowhere_avoided,
        NO_LANDMARKS_NEEDED,
    )
    assert unreachable.views == []
    assert unreachable.rejected[Rejection.UNREACHABLE] > 0
    banned = ranked(
        grid, 0.2, np.zeros((0, 3)), NOWHERE_YET, straight_costs, lambda p: np.ones(len(p), bool), NO_LANDMARKS_NEEDED
    )
    assert banned.views == []
    assert banned.rejected[Rejection.BLACKLISTED] > 0


def test_unknown_ground_is_worth_less_with_every_look_from_the_same_side():
    grid = half_known_room()
    looks = looks_so_far(grid, np.tile([[2.5, 1.9, 0.1]], (2, 1)), CONFIG)
    ahead, beside, far = (
        looks.left[looks.halves[row, column]].tolist()
        for row, column in grid.cells(np.array([[4.0, 2.4], [3.2, 3.5], [5.9, 2.4]]))
    )
    assert ahead[0] == pytest.approx(0.5 ** (2 / CONFIG.looks_to_half))
    assert ahead[1] == ahead[-1] == pytest.approx(0.5 ** (1 / CONFIG.looks_to_half))
    assert ahead[2:-1] == [1.0] * (SECTORS - 3)
    assert beside == far == [1.0] * SECTORS


def test_looks_take_less_memory_than_a_weight_for_every_cell_and_sector():
    grid = half_known_room()
    assert array_bytes(looks_so_far(grid, NOWHERE_YET, CONFIG)) < 20 * grid.data.size


def test_ground_that_is_not_wanted_hides_what_is_behind_it_and_gains_nothing():
    grid = OccupancyGrid(np.full((80, 120), UNKNOWN, np.int8), RESOLUTION, 0.0, 0.0)
    looks, place = looks_so_far(grid, NOWHERE_YET, CONFIG), np.array([[0.5, 2.0]])
    near = np.broadcast_to(np.arange(120) < 40, grid.shape)
    of_all, of_near, of_far = (
        view_gain(grid, place, looks._replace(wanted=np.ascontiguousarray(wanted)), CONFIG)[0, 0]
        for wanted in (looks.wanted, near, ~near)
    )
    assert of_all == pytest.approx(of_near + of_far)
    assert of_near > of_far > 0.0


def test_what_was_looked_at_from_one_side_gains_from_the_other():
    grid = OccupancyGrid(np.full((80, 120), UNKNOWN, np.int8), RESOLUTION, 0.0, 0.0)
    places = np.array([[1.0, 2.0], [4.0, 2.0]])
    before = view_gain(grid, places, looks_so_far(grid, NOWHERE_YET, CONFIG), CONFIG)
    looks = looks_so_far(grid, np.tile([[1.0, 2.0, 0.0]], (6, 1)), CONFIG)
    again, from_behind = view_gain(grid, places, looks, CONFIG) / np.maximum(before, 1e-9)
    assert again[0] < 0.2
    assert from_behind[BEARINGS // 2] == pytest.approx(1.0)


def test_a_long_row_of_dots_is_a_wall_and_a_seen_gap_is_none():
    data = np.full((80, 140), UNKNOWN, np.int8)
    data[30, 5:135:8] = OCCUPIED
    data[30, 70:76] = FREE
    data[50, 20:44:8] = OCCUPIED
    grid = OccupancyGrid(data, RESOLUTION, 0.0, 0.0)
    opaque = opaque_walls(grid, 0.3, 1.0).data
    row = np.delete(opaque[30, 5:134], np.arange(65, 71))
    assert (row == OCCUPIED).all()
    assert (opaque[30, 70:76] == FREE).all()
    assert (opaque[:28] == UNKNOWN).all()
    np.testing.assert_array_equal(opaque[33:], data[33:])
    np.testing.assert_array_equal(opaque_walls(grid, 0.3, 0.3).data, data)


@pytest.mark.parametrize(("width", "open_"), [(16, False), (36, True)])
def test_the_mouth_of_a_corridor_is_no_gap_in_a_wall(width, open_):
    """The wall of a corridor, with an opening behind which nothing is known."""
    data = np.full((120, 160), UNKNOWN, np.int8)
    data[20:60] = FREE
    data[60:62] = OCCUPIED
    data[60:62, 80 - width // 2 : 80 + width // 2] = UNKNOWN
    grid = OccupancyGrid(data, RESOLUTION, 0.0, 0.0)
    gain = gain_at(grid, 0.18, SE2(4.0, 2.0, math.pi / 2.0), NOWHERE_YET, CONFIG)
    assert (gain > 0.5) == open_


def test_a_wall_hides_landmarks():
    data = np.full((80, 120), FREE, np.int8)
    data[:, 60] = OCCUPIED
    grid = OccupancyGrid(data, RESOLUTION, 0.0, 0.0)
    landmarks = np.array([[2.9, 2.0, 0.5], [4.5, 2.0, 0.5]])
    poses = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, math.pi]])
    np.testing.assert_array_equal(count_landmarks(grid, poses, landmarks, CONFIG), [1, 0])


def test_standing_room_keeps_the_radius_from_unknown_and_walls():
    room = traversable_cells(half_known_room(), 0.3)
    cells = np.argwhere(room)
    assert cells[:, 1].max() * RESOLUTION <= 3.0 - 0.3
    assert cells[:, 0].min() * RESOLUTION >= 0.05 + 0.3 - RESOLUTION
    assert len(cells) > 1000


def test_in_a_bare_hall_it_is_not_the_best_views_without_landmarks_that_hide_one_with_some():
    """Thousands of views of a hall show no landmark; the few of a corridor beside it do, and promise less."""
    data = np.full((240, 300), UNKNOWN, np.int8)
    data[20:220, 20:200] = FREE
    data[100:130, 200:260] = FREE
    grid = OccupancyGrid(data, RESOLUTION, 0.0, 0.0)
    landmarks = np.random.default_rng(0).uniform([12.2, 5.0, 0.3], [13.0, 6.5, 1.0], (400, 3))
    ranking = ranked(grid, 0.2, landmarks, NOWHERE_YET, straight_costs, lambda p: np.zeros(len(p), bool), CONFIG)
    assert ranking.views
    assert ranking.views[0].landmarks >= CONFIG.min_landmarks


def test_the_words_begin_with_the_purpose_and_the_figures_multiply_to_u():
    view = View(SE2(1.0, 2.0, 0.0), gain_m2=4.0, distance_m=3.0, landmarks=30, utility=0.4)
    told = Choice(view, None).words(2.0)
    words, figures = told.split(" [")
    assert words == without_figures(told)
    assert words == "driving 3.0 m to look at 4.0 m2 of unknown ground; no other place comes near"
    assert figures.endswith("30 landmarks: U = v/d x landmarks = 4.0 m2 / 5.0 m x 0.50 = 0.40]")
    assert 4.0 / 5.0 * view.landmark_factor(2.0) == pytest.approx(view.utility)


def test_a_choice_names_the_best_view_of_another_place():
    def view(x: float, theta: float, utility: float) -> View:
        return View(SE2(x, -2.04, theta), gain_m2=5.0 * utility, distance_m=3.0, landmarks=60, utility=utility)

    views = [view(1.0, 0.0, 0.8), view(1.2, 0.3, 0.79), view(1.0, math.pi, 0.6), view(-4.0, 0.0, 0.5)]
    told = Choice.among(views, 3.0).words(2.0)
    words, figures = told.split(" [")
    assert words == ("driving 3.0 m to look at 4.0 m2 of unknown ground; second best: 3.0 m2 after 3.0 m, 75 % as good")
    assert "; second best at (1.0, -2.0) looking 180 deg, 60 landmarks: U = 3.0 m2 / 5.0 m x 1.00 = 0.60]" in told
    assert figures.startswith("view at (1.0, -2.0) looking 0 deg")
    assert Choice.among(views[:2], 3.0).second is None, "it looks at the same"
    bare = [each._replace(utility=0.0) for each in views]
    assert "; second best: 3.0 m2 after 3.0 m [" in Choice.among(bare, 3.0).words(2.0)


def test_the_place_of_a_choice_is_read_back_from_its_words():
    view = View(SE2(-11.04, 2.26, math.radians(345.0)), gain_m2=4.0, distance_m=3.0, landmarks=30, utility=0.4)
    place = chosen_in(Choice(view, view).words(2.0))
    assert (place.x, place.y, place.theta) == pytest.approx((-11.0, 2.3, math.radians(345.0)))
    assert chosen_in("driving home") is None
    assert chosen_in("no view found (3 blacklisted): looking again from further back") is None
