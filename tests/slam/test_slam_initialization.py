"""Which of several two-view motions starts the map."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer, TwoViewMap

CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
CONFIG = Config().slam.initialization
SIDEWAYS, AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def hypothesis(direction, support, usable):
    return TwoViewMap(SE3(np.eye(3), direction), support, np.zeros((200, 3)), np.arange(200) < usable)


@pytest.fixture
def initializer():
    return Initializer(CAMERA, None, CONFIG)


def test_parallax_does_not_make_up_for_a_poor_explanation(initializer):
    true, wrong = hypothesis(SIDEWAYS, 0.9, 70), hypothesis(AHEAD, 0.6, 200)
    assert initializer._choose([wrong, true], None) is true
    reason = initializer._choose([wrong, hypothesis(SIDEWAYS, 0.9, 20)], None)
    assert "too little parallax: 20 points" in reason


def test_motions_that_explain_the_matches_equally_well_are_refused(initializer):
    one, other = hypothesis(SIDEWAYS, 0.90, 150), hypothesis(AHEAD, 0.89, 150)
    assert "two motions" in initializer._choose([one, other], None)
    near = hypothesis(np.array([0.995, 0.1, 0.0]) / np.hypot(0.995, 0.1), 0.89, 150)
    assert initializer._choose([near, one], None) is one


def test_refinement_tells_the_true_motion_from_the_mirrored_one(initializer):
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-1, 1, 300), rng.uniform(-0.8, 0.8, 300), rng.uniform(2, 5, 300)])
    true = SE3.exp(np.array([0.2, 0.0, 0.02, 0.0, 0.05, 0.0]))
    moved = true @ points
    rays_a, rays_b = points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:]
    rays_b = rays_b + rng.normal(0, 0.2 / 525.0, rays_b.shape)
    size = np.linalg.norm(true.translation)
    maps = [
        initializer._refine(SE3(true.rotation, sign * true.translation / size), rays_a, rays_b, 1 / 525.0, 0.004)
        for sign in (1.0, -1.0)
    ]
    assert maps[0].support > 0.8
    assert maps[1].support < 0.3
    assert initializer._choose(maps, None).T_b_a.translation == pytest.approx(true.translation / size, abs=0.03)
