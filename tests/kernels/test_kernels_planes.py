"""Which points lie on which planes, and the planes of some points, against whole-array twins."""

import numpy as np
import pytest

from vsx_ros.kernels.dense.plane_choice import best_planes
from vsx_ros.kernels.dense.plane_fits import fit_plane, in_plane_axes, plane_moments
from vsx_ros.kernels.dense.planes import (
    Noise,
    ObservedPoints,
    deviations,
    first_accepted,
    plane_preferences,
    point_information,
)

FLOOR_M, GATE, LIMIT_M = NOISE = Noise(0.01, 2.5, 0.2)


def observed(points, covariances=None, views=None, sigma=None):
    n = len(points)
    covariances = np.zeros((n, 3, 3)) if covariances is None else covariances
    some = np.zeros(n) if sigma is None else sigma
    return ObservedPoints(np.arange(n), points, covariances, np.zeros((n, 3)) if views is None else views, some, some)


def cloud(n, seed=0):
    """Points near the plane through the origin with a skew normal, their covariances, and unit views from its front."""
    rng = np.random.default_rng(seed)
    normal = np.array([0.48, -0.6, 0.64])
    points = rng.normal(size=(n, 3))
    points -= np.outer(points @ normal - 0.02 * rng.normal(size=n), normal)
    root = 0.03 * rng.normal(size=(n, 3, 3))
    views = normal + 0.8 * rng.normal(size=(n, 3))
    return points, root @ root.transpose(0, 2, 1), views / np.linalg.norm(views, axis=1)[:, None], normal


def off(points, covariances, views, plane):
    """(N,) distances to a plane in standard deviations, infinite where it does not count."""
    r = np.abs(points @ plane[:3] - plane[3])
    sigma = np.sqrt(FLOOR_M**2 + np.einsum("i,nij,j->n", plane[:3], covariances, plane[:3]))
    return np.where((views @ plane[:3] > 0.05) & (r <= LIMIT_M), r / sigma, np.inf)


def some_planes(normal):
    planes = np.array([[*normal, 0.0], [*normal, 0.05], [*-normal, 0.0], [0.0, 0.0, 1.0, 0.1]])
    return planes, np.array([in_plane_axes(plane[:3]) for plane in planes])


def test_information_is_blind_along_the_ray():
    rng = np.random.default_rng(3)
    points, centres, noise = rng.normal(size=(4, 3)), rng.normal(size=(3, 3)), rng.uniform(0.001, 0.01, 9)
    keyframe, point = rng.integers(0, 3, 9), rng.integers(0, 4, 9)
    ray = centres[keyframe] - points[point]
    r = np.linalg.norm(ray, axis=1)
    ray /= r[:, None]
    across = (np.eye(3) - ray[:, :, None] * ray[:, None]) / (r * noise)[:, None, None] ** 2
    information, rays, distances = point_information(points, centres, keyframe, point, noise)
    for i in range(4):
        assert np.allclose(information[i], across[point == i].sum(axis=0))
        assert np.allclose(rays[i], ray[point == i].sum(axis=0))
        assert np.allclose(distances[i], [(point == i).sum(), r[point == i].sum()])


def test_deviations_and_preferences_are_distances_over_their_own_noise():
    points, covariances, views, normal = cloud(60)
    planes, _ = some_planes(normal)
    far = np.array([off(points, covariances, views, plane) for plane in planes])
    assert 0 < np.isfinite(far).sum() < far.size
    rows = np.arange(5, 50, 3)
    for plane, expected in zip(planes, far):
        found = deviations(observed(points, covariances, views), rows, plane, NOISE)
        assert np.allclose(found, expected[rows])
    many = np.repeat(planes, 20, axis=0)
    bits = plane_preferences(observed(points, covariances, views), many, NOISE)
    assert bits.shape == (60, 2)
    told = np.unpackbits(bits.view(np.uint8), axis=1, bitorder="little")[:, : len(many)]
    assert np.array_equal(told, np.repeat(far <= GATE, 20, axis=0).T)


def test_every_point_goes_to_the_plane_it_fits_best_and_leaves_small_ones():
    points, covariances, views, normal = cloud(60, seed=4)
    planes, axes = some_planes(normal)
    boxes = np.tile(np.array([[-1.5, -1.5], [1.5, 1.5]]), (4, 1, 1))
    place = np.einsum("gaj,nj->gna", axes, points)
    inside = (np.abs(place) <= 1.5).all(axis=2)
    far = np.where(inside, [off(points, covariances, views, plane) for plane in planes], np.inf)
    far[far >= GATE] = np.inf
    expected = np.where(np.isfinite(far.min(axis=0)), far.argmin(axis=0), -1)
    given = observed(points, covariances, views), planes, axes, boxes
    assert np.array_equal(best_planes(*given, 1, np.arange(4), NOISE), expected)
    sizes = np.bincount(expected[expected >= 0], minlength=4)
    assert (np.sort(sizes)[-2:] > 3).all()
    largest = int(sizes.argmax())
    alone = best_planes(*given, int(sizes.max()), np.argsort(sizes), NOISE)
    assert set(alone.tolist()) <= {-1, largest}
    assert (alone[expected == largest] == largest).all()


def test_the_first_candidate_near_enough_and_not_too_near_is_accepted():
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 2.0], [0.3, 0.0, 0.0], [0.0, 0.4, 0.0], [9.0, 0.0, 0.0]])
    sigmas = np.array([0.01, 0.01, 0.2, 0.01, 0.01])
    candidates, sure = np.array([[1, 2, 4, 3], [1, 2, 4, 4]]), np.zeros((2, 4)) + 1e-9
    first = np.zeros(2, np.int64)
    # 1 is too near across, 2 within two of its own standard deviations, 4 too far away.
    assert first_accepted(observed(points, sigma=sigmas), first, candidates, sure, 2, 0.8, 0.1).tolist() == [3, -1]
    assert first_accepted(observed(points, sigma=sigmas), first, candidates, sure + 1.0, 2, 0.8, 0.1).tolist() == [
        -1,
        -1,
    ]


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.8, 0.0), (0.48, -0.6, 0.64)])
def test_axes_are_right_up_and_normal_of_a_right_handed_frame(normal):
    right, up = in_plane_axes(normal)
    assert np.allclose(np.cross(right, up), normal)
    assert np.allclose([right @ up, right @ right, up @ up], [0.0, 1.0, 1.0])
    assert up @ ([0.0, 1.0, 0.0] if abs(normal[2]) > 0.97 else [0.0, 0.0, 1.0]) > 0.0


def test_moments_are_weighted_by_variance_and_tukey():
    points, covariances, _, normal = cloud(40)
    rows, plane, cutoff = np.arange(3, 37, 2), np.array([*normal, 0.01]), 0.5
    r = points[rows] @ normal - 0.01
    variance = FLOOR_M**2 + np.einsum("i,nij,j->n", normal, covariances[rows], normal)
    weight = np.maximum(0.0, 1.0 - r**2 / (variance * cutoff**2)) ** 2 / variance
    assert 0 < (weight == 0.0).sum() < len(rows)
    mean = weight @ points[rows] / weight.sum()
    d = points[rows] - mean
    total, middle, scatter = plane_moments(observed(points, covariances), rows, plane, FLOOR_M, cutoff)
    assert total == pytest.approx(weight.sum())
    assert np.allclose(middle, mean)
    assert np.allclose(scatter, (weight[:, None] * d).T @ d)
    nothing = plane_moments(observed(points, covariances), rows, plane + [0.0, 0.0, 0.0, 50.0], FLOOR_M, cutoff)
    assert nothing[0] == 0.0


def test_a_fit_is_the_axis_of_least_scatter():
    points, covariances, _, normal = cloud(80)
    points[::10] += 0.8 * normal  # not of this plane
    rows, guess = np.arange(80), normal + [0.1, 0.1, -0.05]
    known, plane, covariance, middle, spread = fit_plane(
        observed(points, covariances), rows, guess / np.linalg.norm(guess), 0, FLOOR_M, 5.0, 20
    )
    assert known
    total, mean, scatter = plane_moments(observed(points, covariances), rows, plane, FLOOR_M, 5.0)
    values, vectors = np.linalg.eigh(scatter)
    assert abs(vectors[:, 0] @ plane[:3]) == pytest.approx(1.0, abs=1e-6)
    assert plane[3] == pytest.approx(plane[:3] @ mean, abs=1e-6)
    assert plane[:3] @ normal > 0.999
    assert np.allclose(middle, mean, atol=1e-5)
    axes = in_plane_axes(plane[:3])
    slopes = np.cross(axes, plane[:3])  # of the normal, as the plane turns about right and about up
    assert np.allclose(covariance[:2, :2], np.linalg.inv(slopes @ scatter @ slopes.T), rtol=1e-3)
    assert covariance[2, 2] == pytest.approx(1.0 / total + FLOOR_M**2, rel=1e-3)
    assert (spread**2).sum() == pytest.approx(values[1:].sum() / total, rel=1e-3)


def test_what_is_fixed_does_not_tilt():
    points, covariances, _, _ = cloud(40)
    guess, rows = np.array([0.6, -0.8, 0.0]), np.arange(40)
    _, upright, _, _, _ = fit_plane(observed(points, covariances), rows, guess, 1, 0.5, 5.0, 6)
    assert upright[2] == pytest.approx(0.0, abs=1e-12)
    assert abs(upright[0] - 0.6) > 1e-3
    _, still, covariance, _, _ = fit_plane(observed(points, covariances), rows, guess, 2, 0.5, 5.0, 6)
    assert np.array_equal(still[:3], guess)
    assert np.count_nonzero(covariance) == 1


def test_points_on_a_line_determine_no_plane():
    points = np.outer(np.linspace(0.0, 1.0, 9), [1.0, 0.0, 0.0])
    assert not fit_plane(observed(points), np.arange(9), np.array([0.0, 0.0, 1.0]), 0, 0.01, 5.0, 4)[0]
