import numpy as np

from vsx_ros.dense.photoconsistency import Judgement
from vsx_ros.dense.region_growing import enclosed, grow_regions


def mask(*rows: str) -> np.ndarray:
    return np.array([[c == "#" for c in row] for row in rows])


NOTHING = mask("......", "......", "......")
NO_RAYS = np.zeros((3, 6), np.int64)


def test_growth_goes_from_seeds_through_strong_cells_over_gaps_of_one() -> None:
    seeds = mask("#.....", "......", "......")
    strong = mask("##.###", "##.###", "##.###")
    # Corners have three neighbours, which is too little company.
    assert (grow_regions(seeds, strong, NOTHING, NO_RAYS) == mask("#...#.", "##.###", "....#.")).all()


def test_strong_cells_out_of_reach_of_any_seed_are_not_believed() -> None:
    seeds = mask("#.....", "......", "......")
    strong = mask("#...##", "....##", "......")
    assert (grow_regions(seeds, strong, NOTHING, NO_RAYS) == seeds).all()


def test_a_weak_cell_needs_two_believed_neighbours() -> None:
    weak = mask("..##..", "..##..", "......")
    one, two = mask(".#....", "......", "......"), mask(".#....", ".#....", "......")
    assert (grow_regions(one, NOTHING, weak, NO_RAYS) == one).all()
    assert (grow_regions(two, NOTHING, weak, NO_RAYS) == mask(".##...", ".##...", "......")).all()


def test_a_chance_match_beside_a_seed_is_not_believed() -> None:
    seeds = mask("......", "#.....", "......")
    strong = mask("......", "#.#...", "......")
    assert (grow_regions(seeds, strong, NOTHING, NO_RAYS) == seeds).all()


def test_what_many_keyframes_look_through_is_never_believed() -> None:
    seeds = mask("###...", "......", "......")
    passing = NO_RAYS.copy()
    passing[0, 1] = 4
    assert (grow_regions(seeds, seeds, NOTHING, passing) == mask("#.#...", "......", "......")).all()


def test_textured_cells_that_differ_and_cells_looked_through_are_refuted() -> None:
    texture, views = np.array([9.0, 9.0, 1.0, 9.0]), np.array([5, 5, 5, 2])
    score, passing = np.array([0.1, 0.6, 0.1, 0.1]), np.array([0, 1, 0, 0])
    said = Judgement(texture, score, np.zeros(4), views, np.zeros(4, np.int64))
    assert said.refuted(passing).tolist() == [True, True, False, False]


def test_holes_are_enclosed_up_to_four_rows_or_one_column() -> None:
    believed = np.zeros((6, 8), np.bool_)
    believed[0, [0, 5]] = True
    believed[1, [0, 6]] = True
    believed[3, 7] = believed[5, 7] = True
    holes = enclosed(believed, np.zeros_like(believed))
    expected = np.zeros_like(believed)
    expected[0, 1:5] = True
    expected[4, 7] = True
    assert (holes == expected).all()
    assert not enclosed(believed, np.ones_like(believed)).any()
