"""Who stands before the camera hides the map; what belongs to the map does not."""

import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.covered import LATELY_S, LEAST_IMAGES, LEAST_POINTS, CoverWatch, covered_ahead
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def scene(rng: np.random.Generator, count: int = 300) -> np.ndarray:
    """(S, 3) points 2 to 5 m before the camera, all over its view [m]."""
    depth = rng.uniform(2.0, 5.0, count)
    return np.column_stack([rng.uniform(-0.55, 0.55, count) * depth, rng.uniform(-0.4, 0.4, count) * depth, depth])


def behind(points: np.ndarray, left_m: float, distance_m: float) -> np.ndarray:
    """(S,) which points a person half a metre wide hides who stands there."""
    return np.abs(points[:, 0] / points[:, 2] - left_m / distance_m) < 0.25 / distance_m


def test_a_person_is_noticed_when_near_and_ahead(rng: np.random.Generator) -> None:
    points = scene(rng)
    luck, every = rng.uniform(size=len(points)) < 0.85, np.ones(len(points), bool)  # found without anybody
    assert covered_ahead(points, luck, every) == ""
    assert "points ahead" in covered_ahead(points, luck & ~behind(points, 0.0, 1.2), every)
    assert covered_ahead(points, luck & ~behind(points, 0.0, 4.0), every) == ""
    assert covered_ahead(points, luck & ~behind(points, 1.0, 1.5), every) == ""


def test_what_a_mapped_thing_hides_does_not_count(rng: np.random.Generator) -> None:
    points = scene(rng)
    gone = behind(points, 0.0, 1.0)
    assert covered_ahead(points, ~gone, ~gone) == ""


def test_images_in_which_little_is_found_anywhere_say_nothing(rng: np.random.Generator) -> None:
    points = scene(rng)
    luck, every = rng.uniform(size=len(points)) < 0.35, np.ones(len(points), bool)
    assert covered_ahead(points, luck, every) == ""
    assert "points ahead" in covered_ahead(points, luck & ~behind(points, 0.0, 0.9), every)


def test_few_points_say_nothing(rng: np.random.Generator) -> None:
    points = scene(rng, LEAST_POINTS - 1) * [0.1, 1.0, 1.0]
    assert covered_ahead(points, np.zeros(len(points), bool), np.ones(len(points), bool)) == ""


def of_image(points: np.ndarray, found: np.ndarray) -> Track:
    """The track of an image from the origin, in which all points were searched."""
    return nothing_tracked("", SE3.identity())._replace(
        searched_rows=np.arange(len(points)), rows=np.flatnonzero(found), state=TrackingState.GOOD
    )


def test_several_images_in_a_row_are_believed_as_long_as_they_say_so(rng: np.random.Generator) -> None:
    watch, points = CoverWatch(), scene(rng)
    hidden = behind(points, 0.0, 1.0)
    free, covered = of_image(points, ~np.zeros_like(hidden)), of_image(points, ~hidden)
    said = [
        bool(watch.ahead(round(1e9 * k / 15), track, points)) for k, track in enumerate([free, *[covered] * 90, free])
    ]
    assert said == [False] * LEAST_IMAGES + [True] * (91 - LEAST_IMAGES) + [False]
    assert watch.ahead(10**10, covered, points) == ""


def test_what_was_not_found_for_seconds_is_behind_a_wall_not_behind_somebody(rng: np.random.Generator) -> None:
    watch, points = CoverWatch(), scene(rng)
    hidden = behind(points, 0.0, 1.0)
    watch.ahead(0, of_image(points, ~np.zeros_like(hidden)), points)
    later_ns = round(1e9 * (LATELY_S + 0.1))
    aside = of_image(points, np.zeros_like(hidden))._replace(searched_rows=np.zeros(0, int))  # it looks elsewhere
    watch.ahead(later_ns - 10**8, aside, points)
    for k in range(2 * LEAST_IMAGES):
        assert watch.ahead(later_ns + round(1e9 * k / 15), of_image(points, ~hidden), points) == ""
