"""Each kernel against a slow twin in plain NumPy."""

import math

import numpy as np
import pytest

from vsx_ros.kernels.occupancy import ground_cells
from vsx_ros.kernels.occupancy import ground_map as kernels
from vsx_ros.kernels.occupancy.ground_cells import Counts
from vsx_ros.occupancy import ground_map

HEIGHTS = (0.06, 0.60, 0.45, 1.0, 0.012)
RANGES = (4.5, 0.0012, 0.10, 0.025, 2.0)
BINS = 360
NONE = np.zeros(0, np.float32)


def scans_of(positions, headings, free):
    return kernels.PolarScans(positions, headings, free, np.zeros_like(free), free, NONE, NONE)


@pytest.fixture(params=[0.31, 0.8])
def scene(request):
    """The camera below, and above, the greatest height at which a ray proves the floor free."""
    rng = np.random.default_rng(4)
    positions = np.column_stack([rng.uniform(-1, 1, (6, 2)), np.full(6, request.param)])
    points = np.column_stack([rng.uniform(-4, 4, (200, 2)), rng.uniform(-0.2, 1.2, 200)])
    keyframe, point = (a.ravel().astype(np.int32) for a in np.meshgrid(np.arange(6), np.arange(200), indexing="ij"))
    keep = rng.uniform(size=len(point)) < 0.5
    return positions, rng.uniform(-4, 4, 6), points, keyframe[keep], point[keep]


def test_parallax_is_the_angle_to_the_first_ray(scene):
    positions, _, points, keyframe, point = scene
    parallax = kernels.point_parallax(positions, points, keyframe, point)
    for p in range(len(points)):
        rays = points[p] - positions[keyframe[point == p]]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        expected = np.arccos(np.clip(rays @ rays[0], -1, 1))[1:].max() if len(rays) > 1 else 0.0
        assert parallax[p] == pytest.approx(expected, abs=1e-9)


def joined(stretches):
    """The stretches (from, to) as few that do not overlap, nearest first."""
    found = []
    for low_from, end in sorted(stretches):
        if found and low_from <= found[-1][1]:
            found[-1][1] = max(found[-1][1], end)
        else:
            found.append([low_from, end])
    return found


def slow_scans(positions, yaws, points, parallax, keyframe, point):
    free, hit, over = np.zeros((len(positions), BINS)), np.zeros(len(point)), np.zeros(len(point))
    nearest, begin, farther = np.full(free.shape, np.inf), np.zeros(free.shape), np.zeros((*free.shape, 2))
    stretches = {}
    for o, (k, p) in enumerate(zip(keyframe, point)):
        d = points[p, :2] - positions[k, :2]
        z, camera_z, distance = points[p, 2], positions[k, 2], math.hypot(*d)
        threshold = 0.06 + 0.012 * distance
        if parallax[p] <= 0 or z < -threshold:
            continue
        error = 0.0012 * distance / parallax[p]
        b = math.floor(((math.atan2(d[1], d[0]) - yaws[k]) / (2 * math.pi) % 1.0) * BINS) % BINS
        end = distance - 2.0 * error - 0.05
        if threshold < z <= 0.60 and error <= 0.10:
            reach = 1 + int(0.025 / distance * BINS / (2 * math.pi))
            for i in range(-reach, reach + 1):
                nearest[k, (b + i) % BINS] = min(nearest[k, (b + i) % BINS], end)
            hit[o] = distance if distance <= 4.5 else 0.0
        elif 0.60 < z <= 1.0 and error <= 0.10:
            over[o] = distance if distance <= 4.5 else 0.0
        if camera_z <= 0.45:
            until = distance * (0.45 - camera_z) / (z - camera_z) if z > 0.45 else np.inf
            free[k, b] = max(free[k, b], min(end, until, 4.5))
        elif z < 0.45:
            low_from = distance * (camera_z - 0.45) / (camera_z - z)
            stretches.setdefault((k, b), []).extend([(low_from, min(end, 4.5))] if min(end, 4.5) > low_from else [])
    for (k, b), found in stretches.items():
        (begin[k, b], free[k, b]), farther[k, b] = [*joined(found), (0, 0), (0, 0)][:2]
    farther[..., 1] = np.minimum(farther[..., 1], nearest)
    return np.maximum(np.minimum(free, nearest), 0), begin, farther, hit, over


def test_scans_agree_with_the_slow_twin(scene):
    positions, yaws, points, keyframe, point = scene
    parallax = kernels.point_parallax(positions, points, keyframe, point)
    headings = np.column_stack([np.cos(yaws), np.sin(yaws)])
    scans = kernels.polar_scans(positions, headings, points, parallax, keyframe, point, BINS, HEIGHTS, RANGES)
    _, _, free, begin, _, hit, over, farther = scans
    slow_free, slow_begin, slow_farther, slow_hit, slow_over = slow_scans(
        positions, yaws, points, parallax, keyframe, point
    )
    assert np.allclose(free, slow_free, atol=1e-6)
    assert np.allclose(begin, slow_begin, atol=1e-6)
    assert np.allclose(farther, slow_farther[: len(farther)], atol=1e-6)
    assert farther.any() == slow_farther.any() == (positions[0, 2] > 0.45)
    assert np.allclose(hit, slow_hit, atol=1e-6)
    assert np.allclose(over, slow_over, atol=1e-6)
    assert (over > 0).any()
    assert (hit > 0).any()
    assert (free > 0).any()


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5, 7 * math.pi])
@pytest.mark.parametrize(("angle", "bin_"), [(1e-9, 0), (-1e-9, 7), (math.pi + 1e-4, 4), (math.pi - 1e-4, 3), (0.8, 1)])
def test_bearings_count_from_the_heading_and_wrap(heading, angle, bin_):
    to = 2.0 * math.cos(heading + angle), 2.0 * math.sin(heading + angle)
    assert kernels.bearing_bin(math.cos(heading), math.sin(heading), *to, 8) == bin_


def test_bearings_are_right_to_a_hundredth_of_a_milliradian():
    angles = np.linspace(0.0, 2.0 * math.pi, 2001)[:-1] + 1e-6
    bins = [kernels.bearing_bin(1.0, 0.0, math.cos(angle), math.sin(angle), 10**7) for angle in angles]
    assert np.allclose(np.array(bins) * 2e-7 * math.pi, angles, atol=2e-5)


def sums_around(counts):
    padded = np.pad(counts, 1)
    rows, columns = counts.shape
    return sum(padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3))


def test_obstacles_are_judged_with_their_neighbours():
    rng = np.random.default_rng(5)
    votes, members, seen = rng.poisson([[[0.4]], [[0.3]], [[6.0]]], (3, 40, 30)).astype(np.int32)
    near, points, free = sums_around(votes), sums_around(members), sums_around(seen) / 9.0
    believed = ground_map.believed(Counts(votes, members), None, seen, 2, 4, (2.0, 1.0))
    assert np.array_equal(believed, (votes > 0) & (points >= 2) & (free <= np.where(points >= 4, 2.0, 1.0) * near))
    assert 50 < believed.sum() < 0.8 * (votes > 0).sum()
    over_votes, over_members = rng.poisson([[[0.3]], [[0.2]]], (2, 40, 30)).astype(np.int32)
    with_over = ground_map.believed(Counts(votes, members), Counts(over_votes, over_members), seen, 2, 4, (2.0, 1.0))
    near_all, points_all = near + sums_around(over_votes), points + sums_around(over_members)
    enough = (points > 0) & (points_all >= 2) & (free <= np.where(points_all >= 4, 2.0, 1.0) * near_all)
    assert np.array_equal(with_over, (votes > 0) & enough)
    assert (with_over & ~believed).sum() > 10
    solid = ground_map.believed(Counts(votes, votes), None, seen, 4, 0, (1.5, 1.5))
    assert np.array_equal(solid, (votes > 0) & (near >= 4) & (free <= 1.5 * near))
    assert 50 < solid.sum() < 0.8 * (votes > 0).sum()


def test_gaps_are_bridged_only_while_they_are_narrow():
    free = np.zeros((1, 360))
    free[0, [0, 3, 10, 30, 359]] = [2.0, 1.0, 3.0, 3.0, 0.5]
    bridged, narrow = free.copy(), free.copy()
    begin = np.zeros_like(free)
    begin[0, [0, 3]] = 0.4, 0.9
    kernels.bridge_gaps(bridged, begin, 8, 0.15)
    assert np.allclose(begin[0, :4], [0.4, 0.9, 0.9, 0.9])
    assert np.allclose(bridged[0, 1:3], 1.0)
    assert np.allclose(bridged[0, 4:10], 1.0)
    assert not bridged[0, 11:30].any()
    kernels.bridge_gaps(narrow, np.zeros_like(narrow), 8, 0.04)
    assert np.allclose(narrow[0, 1:3], 0.04 / math.radians(3))
    assert np.array_equal(narrow[0, [0, 3, 10]], free[0, [0, 3, 10]])


def test_votes_count_keyframes_not_rays():
    free = np.zeros((2, 360))
    free[:, :20] = 1.0
    scans = scans_of(np.array([[0.01, 0.01, 0.3]] * 2), np.array([[1.0, 0.0]] * 2), free)
    votes = ground_cells.count_free(scans, ground_cells.Lattice(60, 60, 0.05, -1.5, -1.5))
    x, y = np.meshgrid(-1.475 + 0.05 * np.arange(60), -1.475 + 0.05 * np.arange(60))
    r, angle = np.hypot(x - 0.01, y - 0.01), np.arctan2(y - 0.01, x - 0.01)
    inside = (r > 0.4) & (r < 0.92) & (angle > 0.08) & (angle < np.deg2rad(20) - 0.08)
    outside = (r > 1.06) | ((r > 0.3) & ((angle < -0.3) | (angle > np.deg2rad(20) + 0.3)))
    assert (votes[inside] == 2).all()
    assert inside.sum() > 20
    assert not votes[outside].any()


def test_votes_of_scans_that_leave_the_grid_are_those_within_it():
    free = np.zeros((2, 360))
    free[:, :90] = 1.4
    at, headings = np.array([[-0.02, 0.01, 0.3], [0.4, -0.6, 0.3]]), np.array([[1.0, 0.0], [0.6, 0.8]])
    whole = ground_cells.count_free(scans_of(at, headings, free), ground_cells.Lattice(80, 80, 0.05, -2.0, -2.0))
    part = ground_cells.count_free(scans_of(at, headings, free), ground_cells.Lattice(20, 24, 0.05, -0.3, -0.1))
    assert np.array_equal(part, whole[38:58, 34:58])
    assert set(np.unique(part)) == {0, 1, 2}


def test_hits_count_observations_and_points(scene):
    _, _, points, _, point = scene
    hit = np.where(np.arange(len(point)) % 3, 1.0, 0.0)
    votes, members = ground_cells.count_hits(points, point, hit, 2, ground_cells.Lattice(100, 90, 0.1, -4.0, -4.0))
    seen = point[hit > 0]
    cells = np.floor((points[:, [1, 0]] + 4.0) / 0.1).astype(int)
    assert set(np.bincount(seen, minlength=len(points))) > {1, 2}
    slow_votes, slow_members = np.zeros((100, 90), int), np.zeros((100, 90), int)
    for row, column in cells[seen]:
        slow_votes[row, column] += 1
    for row, column in cells[np.bincount(seen, minlength=len(points)) >= 2]:
        slow_members[row, column] += 1
    assert np.array_equal(votes, slow_votes)
    assert np.array_equal(members, slow_members)
