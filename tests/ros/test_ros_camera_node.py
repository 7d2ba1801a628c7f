"""The camera node's calibration, without a master."""

import pytest

pytest.importorskip("rospy")

from vsx_ros.errors import ConfigError
from vsx_ros.ros.cameras import nominal, open_camera


@pytest.mark.parametrize(("size", "focal", "centre"), [((640, 480), 525, 239.5), ((1280, 1024), 1050, 479.5)])
def test_an_uncalibrated_kinect_has_nominal_values_in_every_mode(
    size: tuple[int, int], focal: float, centre: float
) -> None:
    camera = nominal("kinect", *size)
    assert (camera.width, camera.height) == size
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (focal, focal, (size[0] - 1) / 2, centre)
    assert nominal("v4l:0", 1280, 1024).cy == 511.5


@pytest.mark.parametrize(
    ("device", "mode"), [("kinectt", "vga"), ("v4l:x", "vga"), ("emulator:", "vga"), ("kinect", "4k"), ("ros:", "vga")]
)
def test_a_device_or_mode_without_meaning_is_refused(device: str, mode: str) -> None:
    with pytest.raises(ConfigError, match="give"):
        open_camera(device, lambda reading: None, mode)
