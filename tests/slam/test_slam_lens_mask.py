"""Where the lens does not hold no point is made, and none is looked for."""

import numpy as np

from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.lens import EQUIDISTANT
from vsx_ros.slam.point_creation import masked

FISHEYE = PinholeCamera(640, 480, 203.7, 203.7, 319.5, 239.5, (0.0, 0.0, 0.0, 0.0), EQUIDISTANT)


def test_the_rim_of_a_fisheye_is_masked_on_every_level():
    for level in range(4):
        shape = 480 >> level, 640 >> level
        out = masked(kernel_camera(FISHEYE), level, shape)
        v, u = np.mgrid[: shape[0], : shape[1]]
        centre = 0.5 * (np.array(shape) - 1)
        radius_px = np.hypot(v - centre[0], u - centre[1]) * 2**level
        limit_px = 203.7 * np.radians(75.0)
        assert out[radius_px > limit_px + 1.0].all()
        assert not out[radius_px < limit_px - 1.0].any()


def test_nothing_of_a_narrow_lens_is_masked():
    assert not masked(kernel_camera(PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)), 0, (480, 640)).any()
