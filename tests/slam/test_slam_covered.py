"""Who stands before the camera hides the map; what belongs to the map does not."""

import numpy as np
import pytest

from vsx_ros.slam.covered import LEAST_IMAGES, LEAST_POINTS, CoverWatch, covered_ahead


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
    luck, none = rng.uniform(size=len(points)) < 0.85, np.zeros(len(points), bool)  # found without anybody
    assert covered_ahead(points, luck, none) == ""
    assert "points ahead" in covered_ahead(points, luck & ~behind(points, 0.0, 1.2), none)
    assert covered_ahead(points, luck & ~behind(points, 0.0, 4.0), none) == ""
    assert covered_ahead(points, luck & ~behind(points, 1.0, 1.5), none) == ""


def test_what_a_mapped_thing_hides_does_not_count(rng: np.random.Generator) -> None:
    points = scene(rng)
    gone = behind(points, 0.0, 1.0)
    assert covered_ahead(points, ~gone, gone) == ""


def test_images_in_which_little_is_found_anywhere_say_nothing(rng: np.random.Generator) -> None:
    points = scene(rng)
    luck, none = rng.uniform(size=len(points)) < 0.35, np.zeros(len(points), bool)
    assert covered_ahead(points, luck, none) == ""
    assert "points ahead" in covered_ahead(points, luck & ~behind(points, 0.0, 0.9), none)


def test_few_points_say_nothing(rng: np.random.Generator) -> None:
    points = scene(rng, LEAST_POINTS - 1) * [0.1, 1.0, 1.0]
    assert covered_ahead(points, np.zeros(len(points), bool), np.zeros(len(points), bool)) == ""


def test_a_single_image_is_not_believed() -> None:
    watch = CoverWatch()
    assert [watch.believed("x") for _ in range(LEAST_IMAGES)] == [""] * (LEAST_IMAGES - 1) + ["x"]
    assert [watch.believed(text) for text in ("", "x")] == ["", ""]
