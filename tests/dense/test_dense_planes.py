import numpy as np
import pytest

from vsx_ros.dense.planes import Plane, PlaneKind, kind_of
from vsx_ros.kernels.dense.plane_fits import in_plane_axes


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
