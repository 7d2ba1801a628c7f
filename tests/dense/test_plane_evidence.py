"""What pictures and rays say about a plane as a whole."""

import numpy as np
from plane_scene import FOCAL_PX, looking, on_wall, seen

from vsx_ros.config import DenseConfig
from vsx_ros.dense.plane_finding import PlaneFinder
from vsx_ros.dense.surface import Surface

CAMERAS = [looking(0.0, 0.12 * k, 0.0) for k in range(-3, 4)]


def surface_of_a_wall():
    """A wall's plane, its points, and its surface, on which every picture is alike and nobody looked through."""
    rng = np.random.default_rng(0)
    snapshot = seen(on_wall((2.5, -1.0), (2.5, 1.0), 120, rng), CAMERAS, rng)
    (plane,) = PlaneFinder(FOCAL_PX, DenseConfig().planes, True).update(snapshot)
    surface = Surface(plane, DenseConfig(), 1.0, True)
    said = surface._said
    said.texture[:], said.score[:], said.rival[:], said.views[:] = 20.0, 0.9, 0.3, 4
    return plane, snapshot.points_world[plane.points], surface


def test_alike_pictures_speak_for_a_plane_and_unlike_ones_against_it():
    plane, points, surface = surface_of_a_wall()
    assert 50.0 < surface.evidence(plane, points) < 200.0
    surface._said.score[:] = 0.2
    assert -200.0 < surface.evidence(plane, points) < -20.0


def test_a_plane_that_many_rays_go_through_is_none():
    plane, points, surface = surface_of_a_wall()
    surface._passing[::2] = 3
    assert surface.evidence(plane, points) < -10.0


def test_a_plane_without_texture_is_left_as_it_is():
    plane, points, surface = surface_of_a_wall()
    surface._said.texture[:] = 0.0
    assert 0.0 < surface.evidence(plane, points) < 50.0
