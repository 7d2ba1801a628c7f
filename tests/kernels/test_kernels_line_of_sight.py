import numpy as np

from vsx_ros.kernels.occupancy.visibility import seen_cells


def test_a_wall_hides_what_is_behind_it_and_is_itself_seen():
    opaque = np.zeros((21, 41), bool)
    opaque[5:16, 20] = True
    seen = seen_cells(opaque, np.array([[10, 10]]), 100.0, 720)
    assert seen[5:16, 20].all()
    assert not seen[8:13, 22:].any()
    assert seen[:, :19].all()
    assert seen[0, 22]


def test_range_is_a_circle():
    seen = seen_cells(np.zeros((41, 41), bool), np.array([[20, 20]]), 10.0, 720)
    row, column = np.mgrid[:41, :41]
    distance = np.hypot(row - 20, column - 20)
    assert seen[distance < 9].all()
    assert not seen[distance > 11].any()


def test_two_viewers_see_what_either_sees():
    opaque = np.zeros((21, 41), bool)
    opaque[:, 20] = True
    viewers = np.array([[10, 10], [10, 30]])
    either = [seen_cells(opaque, viewers[i : i + 1], 50.0, 360) for i in (0, 1)]
    assert np.array_equal(seen_cells(opaque, viewers, 50.0, 360), either[0] | either[1])
