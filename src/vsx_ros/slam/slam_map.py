"""A map with what it was made by, so that another session can go on in it."""

from dataclasses import dataclass

import numpy as np

from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_view import MapView

_SAME = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class SlamMap:
    """All that is needed to continue a map. T_base_cam: the camera's mount; None for a map made without odometry, which
    has no metric scale. view has at least one keyframe."""

    camera: PinholeCamera
    T_base_cam: SE3 | None
    view: MapView

    def resumed(self, camera: PinholeCamera, T_base_cam: SE3 | None) -> Map:
        """The map to go on with. T_base_cam: None for a session without odometry, which any map accepts.

        Raises CalibrationError when the session's calibration or mount is not the map's.
        """
        if not np.allclose(_numbers(camera), _numbers(self.camera), rtol=_SAME, atol=_SAME):
            raise CalibrationError(
                f"the map was made with the calibration {_camera_text(self.camera)}, this camera has "
                f"{_camera_text(camera)}; use the map's calibration or start a new map"
            )
        if T_base_cam is not None and self.T_base_cam is None:
            raise CalibrationError(
                "the map was made without odometry and has no metric scale, this session has odometry; "
                "start a new map with it"
            )
        made, here = self.T_base_cam, T_base_cam
        if made is not None and here is not None and not np.allclose(made.matrix(), here.matrix(), atol=_SAME):
            raise CalibrationError(
                f"the map was made with the camera mounted at {_mount_text(made)}, this robot has it at "
                f"{_mount_text(here)}; use the map's mount (robot.mount) or start a new map"
            )
        return Map.resumed(self.view)


def _numbers(camera: PinholeCamera) -> list[float]:
    return [camera.width, camera.height, *camera.parameters()]


def _camera_text(camera: PinholeCamera) -> str:
    lens = ", ".join(f"{k:.6g}" for k in camera.distortion)
    focal = f"fx {camera.fx:.7g}, fy {camera.fy:.7g}, cx {camera.cx:.7g}, cy {camera.cy:.7g}"
    return f"{camera.width}x{camera.height}, {focal}, distortion [{lens}]"


def _mount_text(T_base_cam: SE3) -> str:
    x, y, z = T_base_cam.translation
    a, b, c = np.degrees(T_base_cam.log()[3:])
    return f"x {x:.4f} y {y:.4f} z {z:.4f} m, rotation vector ({a:.3f}, {b:.3f}, {c:.3f}) deg"
