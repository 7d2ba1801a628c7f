import numpy as np
from plane_scene import FOCAL_PX, angle_deg, looking, on_wall, seen

from vsx_ros.config import PlanesConfig
from vsx_ros.dense.observed_points import observed_points
from vsx_ros.dense.plane_fitting import Attitude, fit_plane
from vsx_ros.dense.plane_merging import Found, merged
from vsx_ros.dense.plane_tiles import noise_of

CAMERAS = [looking(0.0, 0.12 * k, 0.0) for k in range(-3, 4)]


def test_a_plane_of_few_points_that_crosses_a_small_face_does_not_spoil_it():
    rng = np.random.default_rng(0)
    config = PlanesConfig()
    face = on_wall((1.5, -0.3), (1.5, 0.3), 17, rng)
    beside = on_wall((1.55, 0.12), (1.75, 0.3), 6, rng)
    points = observed_points(seen(np.vstack([face, beside]), CAMERAS, rng), FOCAL_PX, config.noise_px)
    noise, rows = noise_of(config, 1.0), np.arange(23)
    small = fit_plane(points, rows[:17], np.array([-1.0, 0.0, 0.0]), Attitude.UPRIGHT, noise)
    # Through the points beside and those of the face that are nearest to them.
    near = np.r_[np.argsort(np.abs(face[:, 1] - 0.08))[:6], rows[17:]]
    crossing = fit_plane(points, near, np.array([-0.67, 0.74, 0.0]), Attitude.UPRIGHT, noise)
    assert small is not None
    assert crossing is not None
    assert angle_deg(small.normal, crossing.normal) > 20.0
    (alone,) = merged([Found(small, rows[:17])], points, config.min_points, noise, 1.0)
    (crossed,) = merged([Found(small, rows[:17]), Found(crossing, near)], points, config.min_points, noise, 1.0)
    assert np.array_equal(crossed.rows, alone.rows)
    assert angle_deg(crossed.fit.normal, small.normal) < 1.0
