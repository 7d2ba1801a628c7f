"""Small loops of every frame against the same in whole arrays."""

import numpy as np
import pytest

from vsx_ros.kernels.slam.tracking import count_hidden, index_rows

TABLE = np.array([[0, 12, 20, 0], [240, 6, 10, 13], [300, 3, 5, 20], [315, 1, 2, 24]])


@pytest.mark.parametrize("many", [0, 1, 40])
def test_every_row_begins_where_a_search_finds_it(many):
    rng = np.random.default_rng(many)
    levels = []
    for _, height, width, _ in TABLE:
        found = np.column_stack([rng.integers(0, width, many), np.sort(rng.integers(0, height, many))])
        levels.append(found.astype(np.int32))
    table = index_rows(np.concatenate(levels), np.full(4, many), TABLE)
    rows = [k * many + np.searchsorted(found[:, 1], np.arange(TABLE[k, 1] + 1)) for k, found in enumerate(levels)]
    assert table.tolist() == np.concatenate(rows).tolist()


def test_hidden_points_are_those_behind_the_nearest_found_one_of_their_cell():
    rng = np.random.default_rng(3)
    uv, depth, found = rng.uniform(0.0, 80.0, (200, 2)), rng.uniform(1.0, 3.0, 200), rng.random(200) < 0.4
    cell = [tuple(at) for at in (uv // 16).astype(int).tolist()]
    expected = 0
    for s in np.flatnonzero(~found):
        before = [depth[o] for o in np.flatnonzero(found) if cell[o] == cell[s]]
        expected += bool(before) and depth[s] > 1.25 * min(before)
    assert 20 < expected < 120
    assert count_hidden(uv, depth, found, 16, 1.25) == expected
    assert count_hidden(uv[:0], depth[:0], found[:0], 16, 1.25) == 0
