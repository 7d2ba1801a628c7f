import numpy as np
import pytest

from vsx_ros.dense.planes import Attitude, Plane, PlaneKind, fit_plane, kind_of
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints


@pytest.mark.parametrize("seed", range(20))
def test_axes_are_right_and_up_as_the_observer_sees_them(seed):
    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    right, up = in_plane_axes(normal)
    assert np.array([right, up, normal]) @ np.array([right, up, normal]).T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det([right, up, normal]) == pytest.approx(1.0)


def test_up_is_up_on_a_wall():
    right, up = in_plane_axes(np.array([-1.0, 0.0, 0.0]))
    assert up == pytest.approx([0.0, 0.0, 1.0])
    assert right == pytest.approx([0.0, -1.0, 0.0])


def test_coordinates_there_and_back():
    normal = np.array([0.6, -0.8, 0.0])
    plane = Plane(1, normal, 1.5, np.eye(3), PlaneKind.WALL, in_plane_axes(normal), np.zeros(4), np.zeros(0, int))
    local = np.array([[0.3, -1.2], [4.0, 2.0]])
    points = plane.points_at(local)
    assert plane.coordinates(points) == pytest.approx(local)
    assert plane.distances(points) == pytest.approx(0.0, abs=1e-12)
    assert plane.distances(points + 0.2 * normal) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("normal", "offset", "kind"),
    [
        ((1.0, 0.0, 0.0), 0.0, PlaneKind.WALL),
        ((0.0, 0.0, 1.0), 0.02, PlaneKind.FLOOR),
        ((0.0, 0.0, 1.0), 0.7, PlaneKind.TABLE),
        ((0.0, 0.0, -1.0), 0.02, PlaneKind.TABLE),
        ((0.0, 0.7, 0.714), 0.0, PlaneKind.OTHER),
    ],
)
def test_kinds(normal, offset, kind):
    assert kind_of(np.array(normal) / np.linalg.norm(normal), offset) is kind


@pytest.mark.parametrize("attitude", [Attitude.FREE, Attitude.UPRIGHT])
def test_a_fit_tells_how_uncertain_the_plane_is_anywhere_on_it(attitude):
    """A wall of which most points are at one end, fitted many times."""
    rng, n, sigma = np.random.default_rng(0), 24, 0.05
    y, z = np.append(rng.uniform(0.0, 0.8, 20), rng.uniform(0.8, 3.0, 4)), rng.uniform(0.2, 1.2, n)
    places = np.array([[2.0, y, z] for y in (0.0, 1.5, 4.0) for z in (0.3, 2.0)])
    covariances, views = np.tile(np.diag([sigma**2, 1e-8, 1e-8]), (n, 1, 1)), np.tile([-1.0, 0.0, 0.0], (n, 1))
    off = []
    for _ in range(1000):
        world = np.column_stack([2.0 + rng.normal(0.0, sigma, n), y, z])
        points = ObservedPoints(np.arange(n), world, covariances, views, np.full(n, sigma), np.full(n, 2.0))
        fit = fit_plane(points, np.arange(n), np.array([-1.0, 0.0, 0.0]), attitude, Noise(1e-4, 2.5, 1.0))
        off.append(places @ fit.normal - fit.offset)
    told = [np.sqrt(fit.covariance_at(place)[2, 2]) for place in places]
    assert told == pytest.approx(np.std(off, axis=0), rel=0.2)
