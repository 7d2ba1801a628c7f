import numpy as np
import pytest
from plane_scene import FOCAL_PX, angle_deg, looking, on_wall, seen

from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.plane_finding import PlaneFinder

CAMERAS = [looking(0.0, 0.12 * k, 0.0) for k in range(-3, 4)]


def rough_room(sigma_m: float, rng: np.random.Generator) -> np.ndarray:
    """A back and a side wall whose points scatter about them, more than the cameras' noise tells."""
    back, side = on_wall((2.5, -1.2), (2.5, 1.2), 200, rng), on_wall((1.0, 1.2), (2.5, 1.2), 150, rng)
    back[:, 0] += sigma_m * rng.normal(size=200)
    side[:, 1] += sigma_m * rng.normal(size=150)
    return np.vstack([back, side])


@pytest.mark.parametrize("seed", range(3))
def test_walls_whose_points_scatter_by_two_centimetres_are_each_found_once(seed):
    rng = np.random.default_rng(seed)
    finder = PlaneFinder(FOCAL_PX, PlanesConfig(), True, seed)
    back, side = finder.update(seen(rough_room(0.02, rng), CAMERAS, rng))
    assert 0.015 < finder.common_sigma_m < 0.026
    assert angle_deg(back.normal, np.array([-1.0, 0.0, 0.0])) < 3.0
    assert angle_deg(side.normal, np.array([0.0, -1.0, 0.0])) < 3.0
    assert len(back.points) > 170
    assert len(side.points) > 110


def test_points_no_worse_than_configured_change_nothing():
    rng = np.random.default_rng(4)
    finder = PlaneFinder(FOCAL_PX, PlanesConfig(), True)
    assert len(finder.update(seen(rough_room(0.005, rng), CAMERAS, rng))) == 2
    assert finder.common_sigma_m == PlanesConfig().floor_sigma_m
