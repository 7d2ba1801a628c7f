"""How wide the camera's view over the floor is, for the choice of views and ways."""

import numpy as np
from msgspec.structs import replace

from vsx_ros.config import Config
from vsx_ros.geometry import lens
from vsx_ros.geometry.camera import PinholeCamera, nominal_camera

_COUNTED_SHARE = 0.96  # of the view: at its border points come and go


def view_rad(camera: PinholeCamera) -> float:
    """The angle [rad], from left to right, in which the SLAM finds points: that of the image, as far as its lens is
    usable, without the border."""
    known = camera.model, camera.distortion
    angles = np.linspace(0.0, lens.usable_angle(*known), 2000)
    sides = np.array([camera.cx + 0.5, camera.width - 0.5 - camera.cx]) / camera.fx
    return _COUNTED_SHARE * float(np.interp(sides, lens.radius(*known, angles), angles).sum())


KINECT_RAD = view_rad(nominal_camera(640, 480))


def with_view(config: Config, fov_rad: float = KINECT_RAD) -> Config:
    """The configuration with the camera's field of view [rad] where it is left open; a Kinect's while unknown."""
    exploration, planner = config.exploration, config.planner
    if exploration.sensor_fov_rad < 0.0:
        exploration = replace(exploration, sensor_fov_rad=fov_rad)
    if planner.sight_fov_rad < 0.0:
        planner = replace(planner, sight_fov_rad=fov_rad)
    return replace(config, exploration=exploration, planner=planner)
