"""The pose of an image that shows a known place, from matched points: wrong matches and points far away do no harm."""

import cv2
import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.place_recognition import PNP_ERROR_PX, pose_from_matches

FOCAL_PX, NOISE_PX, POINTS, WRONG = 525.0, 1.5, 100, 0.3


@pytest.mark.parametrize("far_m", [50.0, 1e3, 1e5])
@pytest.mark.parametrize("far", [0, 2, 5])
def test_a_few_points_far_away_do_not_ruin_the_pose(far: int, far_m: float) -> None:
    rng = np.random.default_rng(far)
    for _ in range(20):
        depth = rng.uniform(2.0, 5.0, POINTS)
        depth[:far] = far_m
        points = np.column_stack([rng.uniform(-0.5, 0.5, (POINTS, 2)) * depth[:, None], depth])
        true = SE3(np.asarray(cv2.Rodrigues(rng.normal(0.0, 0.1, 3))[0]), rng.normal(0.0, 0.2, 3))
        seen = true @ points
        plane = seen[:, :2] / seen[:, 2:] + rng.normal(0.0, NOISE_PX / FOCAL_PX, (POINTS, 2))
        wrong = rng.random(POINTS) < WRONG
        wrong[:far] = False
        plane[wrong] = rng.uniform(-0.5, 0.5, (int(wrong.sum()), 2))
        found = pose_from_matches(points, plane, PNP_ERROR_PX / FOCAL_PX)
        assert found is not None
        pose, agree = found
        assert agree > 0.7 * np.count_nonzero(~wrong)
        assert pose.is_near(true, 0.03, 0.01)
