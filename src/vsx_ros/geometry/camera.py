"""Pinhole camera with plumb-bob (Brown) distortion, as ROS camera_info and OpenCV state it, and its mount."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, Pixels, Points3
from vsx_ros.config import MountConfig
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.se3 import SE3

MAX_PIXELS = 2**25  # no image is larger: twice that of a 16 megapixel camera
VIEW_MIN_DEG, VIEW_MAX_DEG = 10.0, 150.0  # horizontal: what the models of lenses here hold for
ROUND_TRIP_PX = 1.0  # projected and back, median; distortion that cannot be inverted is off by far more
MOUNT_REACH_M = 5.0  # farther from its base no camera is: another unit, most likely
ROTATION_ERROR = 1e-6  # rounding of six digits in a file


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Intrinsics [px] and distortion (k1, k2, p1, p2, k3). Integer pixel coordinates are pixel centres.

    Raises CalibrationError when a value cannot be a camera's."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not all(math.isfinite(n) for n in numbers):
            raise CalibrationError(f"camera calibration holds a number that is not finite: {numbers}")
        if self.width * self.height > MAX_PIXELS:
            raise CalibrationError(
                f"camera calibration is for {self.width}x{self.height}, images have at most {MAX_PIXELS} pixels; "
                "calibrate the camera again"
            )
        if self.width < 16 or self.height < 16 or self.fx <= 0 or self.fy <= 0:
            raise CalibrationError(
                f"camera calibration {self.width}x{self.height}, fx {self.fx}, fy {self.fy} cannot be a "
                "camera's: size must be at least 16x16 and focal lengths positive; calibrate the camera again"
            )

    @property
    def K(self) -> FloatArray:
        """(3, 3) intrinsic matrix [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def parameters(self) -> FloatArray:
        """(9,) fx, fy, cx, cy, k1, k2, p1, p2, k3: what kernels take."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion])

    def project(self, points_cam: Points3) -> Pixels:
        """(N, 2) pixels of (N, 3) points; NaN where the point is not in front of the camera."""
        points_cam = np.asarray(points_cam, float).reshape(-1, 3)
        z = np.where(points_cam[:, 2] > 1e-6, points_cam[:, 2], np.nan)
        x, y = points_cam[:, 0] / z, points_cam[:, 1] / z
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([self.fx * xd + self.cx, self.fy * yd + self.cy], axis=1)

    def unproject(self, pixels: Pixels) -> Points3:
        """(N, 3) points on the plane z = 1 that project to the (N, 2) pixels."""
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        if not any(self.distortion) or not len(pixels):
            x = (pixels[:, 0] - self.cx) / self.fx
            y = (pixels[:, 1] - self.cy) / self.fy
            return np.stack([x, y, np.ones_like(x)], axis=1)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        plane = cv2.undistortPointsIter(
            pixels.reshape(-1, 1, 2), self.K, np.array(self.distortion), np.eye(3), np.eye(3), criteria
        ).reshape(-1, 2)
        return np.column_stack([plane, np.ones(len(plane))])


def nominal_camera(width: int, height: int) -> PinholeCamera:
    """An uncalibrated Kinect's RGB camera (525 px at 640 columns, as ROS' own default), for images of any size [px]."""
    focal = 525.0 * width / 640.0
    return PinholeCamera(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))


def mount_pose(forward: float, left: float, height: float, pitch: float, yaw: float = 0.0) -> SE3:
    """T_base_cam of a camera on a robot: position [m] in the base frame, pitch down and yaw left positive [rad].

    Base: x forward, z up. Camera (optical): z forward, x right, y down (REP 103)."""
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return SE3(Rz @ Ry @ optical, np.array([forward, left, height]))


def mounted(mount: MountConfig) -> SE3:
    """T_base_cam of a camera that sits on the base as configured."""
    return mount_pose(mount.forward_m, mount.left_m, mount.height_m, mount.pitch_down_rad, mount.yaw_left_rad)


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
