"""A calibration or a mount that no robot has would bend or tear the map in silence: refused before the first frame."""

import math

import numpy as np

from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3

VIEW_MIN_DEG, VIEW_MAX_DEG = 10.0, 150.0
ROUND_TRIP_PX = 1.0
MOUNT_REACH_M = 5.0
ROTATION_ERROR = 1e-6


def check_calibration(camera: PinholeCamera, T_base_cam: SE3 | None) -> None:
    """Raises CalibrationError for a field of view, principal point, distortion or mount that cannot be."""
    again = "check the calibration file or calibrate the camera again"
    view_deg = math.degrees(2.0 * math.atan(0.5 * camera.width / camera.fx))
    if not VIEW_MIN_DEG <= view_deg <= VIEW_MAX_DEG or not 0.5 <= camera.fx / camera.fy <= 2.0:
        raise CalibrationError(
            f"focal lengths fx {camera.fx:g}, fy {camera.fy:g} px make a view of {view_deg:.3g} deg at "
            f"{camera.width} columns; {VIEW_MIN_DEG:g} to {VIEW_MAX_DEG:g} deg are possible: {again}"
        )
    if not (0.0 < camera.cx < camera.width and 0.0 < camera.cy < camera.height):
        raise CalibrationError(
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies outside the image of "
            f"{camera.width}x{camera.height}: {again}"
        )
    u, v = np.linspace(0.0, camera.width - 1.0, 9), np.linspace(0.0, camera.height - 1.0, 9)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    error = np.abs(camera.project(camera.unproject(pixels)) - pixels).max(axis=1)
    # The outermost pixels of a real lens may lie beyond where its polynomial holds; most of the image may not.
    if not float(np.median(error)) < ROUND_TRIP_PX:
        raise CalibrationError(f"the distortion {camera.distortion} cannot be undone over most of the image: {again}")
    if T_base_cam is not None:
        _check_mount(T_base_cam)


def _check_mount(T_base_cam: SE3) -> None:
    R, t = T_base_cam.rotation, T_base_cam.translation
    if not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise CalibrationError(f"the camera mount T_base_cam holds a number that is not finite: position {t.tolist()}")
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_ERROR or np.linalg.det(R) < 0.0:
        raise CalibrationError(
            f"the camera mount T_base_cam holds no rotation: {R.tolist()}; its rows must be orthonormal"
        )
    if np.linalg.norm(t) > MOUNT_REACH_M:
        raise CalibrationError(
            f"the mount T_base_cam puts the camera {np.linalg.norm(t):g} m from the base; positions are in metres"
        )
