from fractions import Fraction

import numpy as np
import pytest

from vsx_ros.dense.plane_tiles import cluster
from vsx_ros.errors import InputError


def packed(sets: list[set[int]], words: int = 1) -> np.ndarray:
    rows = np.zeros((len(sets), words), np.uint64)
    for i, models in enumerate(sets):
        for h in models:
            rows[i, h // 64] |= np.uint64(1) << np.uint64(h % 64)
    return rows


def unpacked(row: np.ndarray) -> frozenset[int]:
    return frozenset(h for h in range(64 * len(row)) if int(row[h // 64]) >> (h % 64) & 1)


def partition(labels: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(labels == k).tolist()) for k in set(labels.tolist()) if k >= 0}


def by_definition(rows: np.ndarray) -> set[frozenset[int]]:
    """All pairs compared at each step; equal rows first, then the first of equally near pairs."""
    clusters = [
        (unpacked(row), frozenset(np.flatnonzero((rows == row).all(axis=1)).tolist()))
        for row in np.unique(rows, axis=0)
        if row.any()
    ]
    while True:
        best, pair = Fraction(1), None
        for i in range(len(clusters)):
            for j in range(i + 1, len(clusters)):
                a, b = clusters[i][0], clusters[j][0]
                distance = 1 - Fraction(len(a & b), len(a | b)) if a | b else Fraction(1)
                if distance < best:
                    best, pair = distance, (i, j)
        if pair is None:
            return {members for _, members in clusters}
        (a, mine), (b, others) = clusters[pair[0]], clusters[pair[1]]
        clusters[pair[0]] = (a & b, mine | others)
        del clusters[pair[1]]


@pytest.mark.parametrize("seed", range(25))
def test_it_does_what_the_definition_says(seed):
    rng = np.random.default_rng(seed)
    density = rng.uniform(0.05, 0.5)
    sets = [set(np.flatnonzero(rng.random(70) < density).tolist()) for _ in range(rng.integers(2, 40))]
    rows = packed(sets, 2)
    assert partition(cluster(rows)) == by_definition(rows)


def test_an_intersection_may_come_nearer_to_a_third_set():
    # {1,2,3} and {1,4,5} are 2/3 from {1}; merged they are {1} and at distance 0 from it. {4,5,6,7} takes {1,4,5} first
    # where distances are not kept up to date.
    assert partition(cluster(packed([{1, 2, 3}, {1, 4, 5}, {1}]))) == {frozenset({0, 1, 2})}
    sets = [{1, 2, 3, 4}, {1, 2, 5, 6}, {1, 2}, {2, 7, 8}]
    assert partition(cluster(packed(sets))) == by_definition(packed(sets))


def test_the_order_of_the_points_does_not_matter():
    rng = np.random.default_rng(3)
    rows = packed([set(np.flatnonzero(rng.random(60) < 0.2).tolist()) for _ in range(60)])
    labels = cluster(rows)
    for _ in range(5):
        order = rng.permutation(len(rows))
        moved = {frozenset(order[list(members)].tolist()) for members in partition(cluster(rows[order]))}
        assert moved == partition(labels)


def test_points_without_a_model_have_no_cluster_and_labels_count_up():
    assert cluster(packed([set(), {5}, {3}, {5}, set(), {3}])).tolist() == [-1, 0, 1, 0, -1, 1]
    assert cluster(np.zeros((0, 3), np.uint64)).tolist() == []


def test_two_structures_and_outliers():
    rng = np.random.default_rng(0)
    truth, model = np.repeat([0, 1, 2], [40, 30, 20]), np.repeat([0, 1, 2], [300, 300, 40])
    share = np.where(truth[:, None] != model, 0.0, np.where(truth < 2, 0.97, 0.03)[:, None])
    rows = packed([set(np.flatnonzero(chosen).tolist()) for chosen in rng.random(share.shape) < share], 10)
    labels = cluster(rows)
    sizes = np.bincount(labels[labels >= 0])
    first, second = np.argsort(-sizes)[:2]
    assert np.array_equal(labels == first, truth == 0)
    assert np.array_equal(labels == second, truth == 1)
    assert 1 <= np.sort(sizes)[-3] <= 8


def test_rows_of_another_type_are_refused():
    with pytest.raises(InputError, match="int64"):
        cluster(np.zeros((3, 2), np.int64))
    with pytest.raises(InputError, match="W <= 1023"):
        cluster(np.zeros((3, 1024), np.uint64))
