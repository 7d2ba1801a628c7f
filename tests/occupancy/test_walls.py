import numpy as np

from vsx_ros.occupancy.unknown_ground import walls

RESOLUTION = 0.05


def row_of_dots(every):
    occupied = np.zeros((40, 160), bool)
    occupied[20, 10:151:every] = True
    return occupied


def test_a_straight_wall_seen_at_every_second_cell_is_a_wall():
    found = walls(row_of_dots(2), RESOLUTION, 0.05, 1.0, share=0.5)
    assert found[20, 10:150].all()
    assert not found[:18].any()
    assert not found[23:].any()


def test_things_in_line_are_no_wall():
    dots = row_of_dots(8)
    assert walls(dots, RESOLUTION, 0.05, 1.0)[20, 10:140].all()
    assert np.array_equal(walls(dots, RESOLUTION, 0.05, 1.0, share=0.5), dots)


def test_a_gap_longer_than_asked_stays_open():
    occupied = row_of_dots(1)
    occupied[20, 60:90] = False
    found = walls(occupied, RESOLUTION, 0.05, 1.0, share=0.5)
    assert not found[20, 62:88].any()
    assert found[20, 10:60].all()
    assert found[20, 90:150].all()


def test_what_is_too_narrow_for_the_robot_is_closed_and_what_is_wide_enough_is_not():
    for slit, closed in ((5, True), (9, False)):
        occupied = np.ones((30, 40), bool)
        occupied[:, 20 : 20 + slit] = False
        assert walls(occupied, RESOLUTION, 0.35, 0.05)[10:20].all() == closed


def test_nothing_is_no_wall():
    assert not walls(np.zeros((5, 7), bool), RESOLUTION, 0.35, 1.0).any()
