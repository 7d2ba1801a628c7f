"""The map laid over the truth: what is found, missing, and made up can be told apart."""

import numpy as np

from vsx_ros.evaluation.figure5 import map_on_truth_picture, truth_picture
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

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
