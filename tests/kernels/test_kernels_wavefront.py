"""The wavefront against Dijkstra's search, cell by cell."""

import heapq
import math

import numpy as np
import pytest

from vsx_ros.kernels.occupancy.clearance import wavefront

AROUND = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1) if di or dj]


def dijkstra(open_cells, start):
    rows, columns = open_cells.shape
    distance = np.full((rows, columns), np.inf)
    distance[start], heap = 0.0, [(0.0, start)]
    while heap:
        d, (i, j) = heapq.heappop(heap)
        if d > distance[i, j]:
            continue
        for di, dj in AROUND:
            a, b = i + di, j + dj
            if not (0 <= a < rows and 0 <= b < columns and open_cells[a, b]):
                continue
            if di and dj and (i, j) != start and not (open_cells[i, b] and open_cells[a, j]):
                continue
            if d + math.hypot(di, dj) < distance[a, b] - 1e-9:
                distance[a, b] = d + math.hypot(di, dj)
                heapq.heappush(heap, (distance[a, b], (a, b)))
    return distance


@pytest.mark.parametrize("seed", range(4))
def test_lengths_are_those_of_dijkstra(seed):
    open_cells = np.random.default_rng(seed).random((15, 22)) < 0.7
    expected = dijkstra(open_cells, (7, 11))
    assert 20 < np.isfinite(expected).sum() < open_cells.size
    assert np.allclose(wavefront(open_cells, 7, 11), expected)


def test_a_way_that_turns_back_is_as_long_as_its_corridor():
    open_cells = np.zeros((5, 9), bool)
    open_cells[0], open_cells[2], open_cells[4] = True, True, True
    open_cells[1, 8], open_cells[3, 0] = True, True
    distance = wavefront(open_cells, 0, 0)
    assert distance[4, 8] == pytest.approx(3 * 8 + 4)  # no corner is cut
    assert np.isinf(distance[~open_cells]).all()
