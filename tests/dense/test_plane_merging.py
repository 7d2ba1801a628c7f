import numpy as np
import pytest
from plane_scene import FOCAL_PX, angle_deg, looking, on_wall, seen

from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.plane_finding import observed_points
from vsx_ros.dense.plane_merging import Found, merged
from vsx_ros.dense.planes import Attitude, Fit, fit_plane
from vsx_ros.kernels.dense.planes import Noise

CAMERAS = [looking(0.0, 0.12 * k, 0.0) for k in range(-3, 4)]
TOWARDS = np.array([-1.0, 0.0, 0.0])


def turned(fit: Fit, angle_rad: float, y: float) -> Fit:
    """The vertical plane x = 1.5 turned about the vertical at y, as J-linkage finds planes: some degrees off."""
    normal = np.array([-np.cos(angle_rad), -np.sin(angle_rad), 0.0])
    return fit._replace(normal=normal, offset=float(normal @ [1.5, y, 0.0]))


@pytest.mark.parametrize("seed", range(3))
def test_a_smaller_plane_that_crosses_a_face_does_not_spoil_it(seed):
    rng = np.random.default_rng(seed)
    config = PlanesConfig()
    points = observed_points(seen(on_wall((1.5, -0.3), (1.5, 0.3), 17, rng), CAMERAS, rng), FOCAL_PX, config.noise_px)
    noise, rows = Noise(config.floor_sigma_m, config.inlier_sigmas, config.max_distance_m), np.arange(17)
    fit = fit_plane(points, rows, TOWARDS, Attitude.UPRIGHT, noise)
    assert fit is not None
    face = Found(turned(fit, 0.07, 0.0), rows)
    crossing = Found(turned(fit, -0.16, 0.15), np.flatnonzero(points.world[:, 1] > 0.0))
    (alone,) = merged([face], points, config.min_points, noise, 1.0)
    (crossed,) = merged([face, crossing], points, config.min_points, noise, 1.0)
    assert np.array_equal(crossed.rows, alone.rows)
    assert angle_deg(crossed.fit.normal, TOWARDS) < 4.0
