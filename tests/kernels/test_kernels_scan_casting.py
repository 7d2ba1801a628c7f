"""Polar scans laid into the grid, against circles, points along rays and whole arrays."""

import math

import numpy as np
import pytest

from vsx_ros.kernels.occupancy.ground_cells import Lattice, cast, count_free, half_bearings, scan_corners
from vsx_ros.kernels.occupancy.ground_map import PolarScans

N_BEARINGS = 120


def scans_of(positions, headings, free, hit=None):
    return PolarScans(
        positions, headings, free, np.zeros_like(free), free, *[np.zeros(0, np.float32) if hit is None else hit] * 2
    )


def middles(rows, columns, resolution, origin):
    row, column = np.mgrid[:rows, :columns]
    return np.stack([origin[0] + (column + 0.5) * resolution, origin[1] + (row + 0.5) * resolution], axis=-1)


def test_half_bearings_are_edges_and_middles_of_bins_in_turn():
    angle = np.arange(16) * 2.0 * math.pi / 16
    assert np.allclose(half_bearings(8), np.column_stack([np.cos(angle), np.sin(angle)]))


def test_a_scan_that_is_free_all_around_counts_the_cells_of_its_disc_once():
    positions, headings = np.array([[0.13, 0.07, 0.5], [0.4, -0.3, 0.5]]), np.array([[1.0, 0.0], [0.6, 0.8]])
    reach, resolution, origin = np.array([0.9, 0.6]), 0.05, (-1.0, -1.0)
    free = np.repeat(reach[:, None], N_BEARINGS, axis=1).astype(np.float32)
    votes = count_free(scans_of(positions, headings, free), Lattice(44, 40, resolution, *origin))
    at = middles(44, 40, resolution, origin)
    distance = np.linalg.norm(at[:, :, None] - positions[:, :2], axis=-1)
    assert votes.dtype == np.int32
    assert (votes >= (distance < reach - resolution).sum(axis=2)).all()
    assert (votes <= (distance < reach + resolution).sum(axis=2)).all()
    assert votes.max() == 2


def cells_between(place, angle, begin, until):
    """Cells (row, column) of the points half a cell apart along a ray, all in cells."""
    along = 0.5 * np.arange(int(2.0 * begin), int(2.0 * until) + 1 if until > begin else 0)
    x, y = place[0] + along * math.cos(angle), place[1] + along * math.sin(angle)
    return set(zip(np.floor(y).astype(int).tolist(), np.floor(x).astype(int).tolist()))


def test_rays_are_shared_near_the_camera_as_far_as_all_their_bins_are_free():
    rng = np.random.default_rng(1)
    free = rng.uniform(-0.2, 1.0, (2, N_BEARINGS)).astype(np.float32)
    free = np.maximum(np.repeat(free[:, ::3], 3, axis=1), 0.0)
    positions, angle, width = rng.uniform(-0.2, 0.2, (2, 3)), np.array([0.4, 2.0]), 2.0 * math.pi / N_BEARINGS
    resolution, origin = 0.05, (-0.8, -0.9)
    expected = np.zeros((34, 32), np.int32)
    most = 0.8 / width / 2.0  # cells, up to where rays two bins apart lie no more than 0.8 cells apart
    for k in range(2):
        place, reach, cells = (positions[k, :2] - origin) / resolution, free[k] / resolution, set()
        for b in range(0, N_BEARINGS, 4):
            shared = min(0.5 * most, reach[b : b + 4].min())
            cells |= cells_between(place, angle[k] + (b + 2) * width, 0.0, shared)
            for at in (b, b + 2):
                until = max(shared, min(most, reach[at : at + 2].min()))
                cells |= cells_between(place, angle[k] + (at + 1) * width, shared, until)
                for j in (at, at + 1):
                    cells |= cells_between(place, angle[k] + (j + 0.5) * width, until, reach[j])
        for row, column in cells:
            if 0 <= row < 34 and 0 <= column < 32:
                expected[row, column] += 1
    headings = np.column_stack([np.cos(angle), np.sin(angle)])
    votes = count_free(scans_of(positions, headings, free), Lattice(34, 32, resolution, *origin))
    assert 200 < (expected > 0).sum() < 1000
    assert np.array_equal(votes, expected)


def test_rays_of_a_high_camera_count_on_both_of_their_stretches():
    rng = np.random.default_rng(3)
    begin = rng.uniform(0.1, 0.4, (2, N_BEARINGS)).astype(np.float32)
    free = (begin + rng.uniform(-0.1, 0.3, begin.shape)).astype(np.float32)
    farther = np.cumsum(rng.uniform(0.1, 0.4, (2, N_BEARINGS, 2)), axis=2).astype(np.float32) + free[..., None]
    farther[:, ::3] = 0.0
    positions, angle, width = rng.uniform(-0.2, 0.2, (2, 3)), np.array([0.4, 2.0]), 2.0 * math.pi / N_BEARINGS
    expected = np.zeros((70, 72), np.int32)
    for k in range(2):
        place, cells = (positions[k, :2] + 1.8) / 0.05, set()
        for b in range(N_BEARINGS):
            for first, last in ((begin[k, b], free[k, b]), farther[k, b]):
                cells |= cells_between(place, angle[k] + (b + 0.5) * width, first / 0.05, last / 0.05)
        for row, column in cells:
            if 0 <= row < 70 and 0 <= column < 72:
                expected[row, column] += 1
    headings = np.column_stack([np.cos(angle), np.sin(angle)])
    scans = scans_of(positions, headings, free)._replace(begin=begin, farther=farther)
    assert 200 < (expected > 0).sum() < 3000
    assert np.array_equal(count_free(scans, Lattice(70, 72, 0.05, -1.8, -1.8)), expected)


@pytest.mark.parametrize(("begin", "reach", "limit"), [(0.0, 30.0, math.inf), (3.0, 12.0, 8.0), (5.0, 4.0, 9.0)])
def test_a_ray_counts_the_cells_of_its_points_once_for_each_keyframe(begin, reach, limit):
    heading, bearing = 0.7, np.array([math.cos(0.4), math.sin(0.4)])
    frame = (6.3, 4.8, math.cos(heading), math.sin(heading))
    votes = np.zeros((16, 14), np.int64)
    until = max(begin, min(reach, limit))
    for number in (1, 1, 2):
        assert cast(votes, number, frame, bearing, begin, reach, limit) == until
    expected = np.zeros_like(votes)
    for row, column in cells_between(frame[:2], heading + 0.4, begin, until):
        if 0 <= row < 16 and 0 <= column < 14:
            expected[row, column] = 2
    assert np.array_equal(votes & 0xFFFFFFFF, expected)


def test_corners_hold_cameras_ends_of_scans_and_hits():
    rng = np.random.default_rng(2)
    positions, angle = rng.normal(size=(3, 3)), rng.uniform(0.0, 6.0, 3)
    headings = np.column_stack([np.cos(angle), np.sin(angle)])
    free = np.maximum(0.0, rng.uniform(-1.0, 2.0, (3, 8))).astype(np.float32)
    points, hit = rng.normal(size=(5, 3)) * 4.0, np.array([1.0, 0.0, 2.0], np.float32)
    seen = np.array([4, 0, 2], np.int32)
    bearing = angle[:, None] + (np.arange(8) + 0.5) * 2.0 * math.pi / 8
    ends = positions[:, None, :2] + free[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    known = np.vstack([positions[:, :2], ends[free > 0.0], points[[4, 2], :2]])
    corners = scan_corners(scans_of(positions, headings, free, hit), points, seen)
    assert np.allclose(corners, [known.min(axis=0), known.max(axis=0)])
    farther = np.zeros((3, 8, 2), np.float32)
    farther[1, 5] = 8.0, 9.0
    end = positions[1, :2] + 9.0 * np.array([np.cos(bearing[1, 5]), np.sin(bearing[1, 5])])
    far = scan_corners(scans_of(positions, headings, free, hit)._replace(farther=farther), points, seen)
    assert np.allclose(far, [np.minimum(known.min(axis=0), end), np.maximum(known.max(axis=0), end)])
