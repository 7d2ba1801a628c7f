"""How wide a camera sees, and where that enters the configuration."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config, from_dict, overridden
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.view import KINECT_RAD, view_rad, with_view
from vsx_ros.sim.camera import KINECT

SHARE = 0.96
OPEN = "planner.sight_fov_rad", "exploration.sensor_fov_rad"


def camera(fx: float, cx: float = 319.5, **lens) -> PinholeCamera:
    return PinholeCamera(640, 480, fx, fx, cx, 239.5, **lens)


@pytest.mark.parametrize("fx", [350.0, 525.0, 700.0])
def test_the_view_is_that_of_the_image_without_its_border(fx: float) -> None:
    assert view_rad(camera(fx)) == pytest.approx(SHARE * 2.0 * math.atan(320.0 / fx), abs=1e-5)


def test_an_emulated_kinect_has_a_kinects_view() -> None:
    assert pytest.approx(1.05, rel=0.01) == KINECT_RAD
    assert view_rad(KINECT) == pytest.approx(1.05, rel=0.01)


def test_the_lens_is_taken_into_account() -> None:
    bent = camera(525.0, distortion=(-0.3, 0.1, 0.0, 0.0, 0.0))
    left, right = bent.unproject(np.array([[-0.5, 239.5], [639.5, 239.5]]))[:, 0]
    assert view_rad(bent) == pytest.approx(SHARE * (math.atan(right) - math.atan(left)), abs=1e-5)
    assert view_rad(bent) > 1.02 * view_rad(camera(525.0))


def test_of_a_fisheye_only_what_the_slam_uses_counts() -> None:
    wide = camera(160.0, distortion=(0.0, 0.0, 0.0, 0.0), model="equidistant")  # 229 deg
    assert view_rad(wide) == pytest.approx(SHARE * math.radians(150.0), abs=1e-5)


def test_what_is_configured_stays() -> None:
    config = with_view(overridden(Config(), {OPEN[0]: 0.7}), 1.4)
    assert (config.planner.sight_fov_rad, config.exploration.sensor_fov_rad) == (0.7, 1.4)
    assert with_view(Config()).planner.sight_fov_rad == KINECT_RAD


@pytest.mark.parametrize("name", OPEN)
@pytest.mark.parametrize("value", [-0.5, 0.0, 0.05])
def test_a_view_of_nothing_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"{name} is {value:g}; give -1 \(the calibration's\) or at least 0.1"):
        overridden(Config(), {name: value})


def test_an_old_file_that_gives_both_is_read() -> None:
    config = from_dict({"planner": {"sight_fov_rad": 1.05}, "exploration": {"sensor_fov_rad": 1.05}})
    assert with_view(config, 2.0) == config
