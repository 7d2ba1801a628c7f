"""A camera: intrinsics and lens, as in ROS camera_info and OpenCV, and its shutter."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros import MAX_PIXELS as MAX_PIXELS
from vsx_ros.arrays import BoolArray, FloatArray, Pixels, Points3
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry import lens
from vsx_ros.geometry.se3 import SE3

VIEW_MIN_DEG, VIEW_MAX_DEG = 10.0, 150.0  # horizontal: what a planar image can hold
FISHEYE_VIEW_MAX_DEG = 250.0  # the widest on the market
BORDER = 1.1  # times the radius of the farthest corner: limit of predictions beyond the image
MOUNT_REACH_M = 5.0  # no camera is farther from its base; more is probably a wrong unit
SHUTTER_MAX_S = 0.2  # of readout and of exposure, as in config.slam.shutter; more is probably in milliseconds
ROTATION_ERROR = 1e-6  # rounding of six digits in a file


class Shutter(NamedTuple):
    """Exposure of a camera: its rows one after the other within readout_s (0: all at once), each for exposure_s."""

    readout_s: float
    exposure_s: float

    @property
    def is_possible(self) -> bool:
        """Whether a camera can have these times."""
        return all(0.0 <= time <= SHUTTER_MAX_S for time in self)


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Intrinsics [px], coefficients of one of the ``lens`` models, and the shutter (None if not measured). Integer
    pixel coordinates are pixel centres.

    Raises CalibrationError for impossible values."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    model: str = lens.PLUMB_BOB
    shutter: Shutter | None = None

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion, *(self.shutter or ()))
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
        if lens.COEFFICIENTS.get(self.model) != len(self.distortion):
            known = ", ".join(f"{name} ({count})" for name, count in lens.COEFFICIENTS.items())
            raise CalibrationError(
                f"camera calibration has the distortion model {self.model!r} with {len(self.distortion)} "
                f"coefficients; known are {known}: calibrate with one of these"
            )
        if self.shutter is not None and not self.shutter.is_possible:
            raise CalibrationError(
                f"camera calibration has {self.shutter}; times cannot be negative or above {SHUTTER_MAX_S:g} s: "
                "give seconds, or remove them"
            )

    @property
    def K(self) -> FloatArray:
        """(3, 3) intrinsic matrix [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def focal_px(self) -> tuple[float, float]:
        """fx and fy."""
        return self.fx, self.fy

    def parameters(self) -> FloatArray:
        """fx, fy, cx, cy and the model's coefficients."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion])

    def project(self, points_cam: Points3) -> Pixels:
        """(N, 2) pixels of (N, 3) points; NaN where the lens does not see the point: behind, or beyond its usable
        angle."""
        from vsx_ros.kernels.geometry import project_points  # avoids loading the compiler with the module

        points_cam = np.asarray(points_cam, float).reshape(-1, 3)
        z = np.where(points_cam[:, 2] > 1e-6, points_cam[:, 2], np.nan)
        plane = points_cam[:, :2] / z[:, None]
        plane[~((plane**2).sum(axis=1) <= math.tan(lens.usable_angle(self.model, self.distortion)) ** 2)] = np.nan
        return project_points(kernel_camera(self), plane)

    def unproject(self, pixels: Pixels) -> Points3:
        """(N, 3) points on the plane z = 1 that project to the (N, 2) pixels; meaningless where these are not
        ``usable``."""
        from vsx_ros.kernels.geometry import unproject_pixels

        pixels = np.ascontiguousarray(pixels, float).reshape(-1, 2)
        return np.column_stack([unproject_pixels(kernel_camera(self), pixels), np.ones(len(pixels))])

    def undistortion(self) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
        """Maps for ``cv2.remap`` to a picture of the same size and K without distortion."""
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        ideal = np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy], axis=-1).reshape(-1, 2)
        seen = self.project(np.column_stack([ideal, np.ones(len(ideal))])).reshape(self.height, self.width, 2)
        u, v = np.moveaxis(np.nan_to_num(seen, nan=-1e4).astype(np.float32), 2, 0)
        rounded, fraction = cv2.convertMaps(u, v, cv2.CV_16SC2)
        return np.asarray(rounded, np.int16), np.asarray(fraction, np.uint16)


def kernel_camera(camera: PinholeCamera) -> FloatArray:
    """(CAMERA,) the kernels' array of a camera at rest."""
    return _standing(camera).copy()


@lru_cache(maxsize=32)
def _standing(camera: PinholeCamera) -> FloatArray:
    """The usable part ends where that of the lens ends, or a little beyond the farthest corner of the image."""
    from vsx_ros.kernels import lens as array

    known = camera.model, camera.distortion
    angles = np.linspace(0.0, lens.usable_angle(*known), 2000)
    radii = lens.radius(*known, angles)
    across, down = (max(c, n - 1 - c) / f for c, n, f in (
        (camera.cx, camera.width, camera.fx), (camera.cy, camera.height, camera.fy)))  # fmt: skip
    angle = float(np.interp(BORDER * math.hypot(across, down), radii, angles))
    coefficients = np.zeros(8)
    coefficients[: len(camera.distortion)] = camera.distortion
    out = np.zeros(array.CAMERA)
    out[: array.LENS] = camera.fx, camera.fy, camera.cx, camera.cy
    out[array.LENS : array.PLANE_R2] = coefficients[:5]
    out[array.PLANE_R2] = math.tan(angle) ** 2
    out[array.WIDTH], out[array.HEIGHT] = camera.width, camera.height
    out[array.RATIONAL : array.RATIONAL + 3] = coefficients[5:]
    out[array.MODEL] = array.EQUIDISTANT if camera.model == lens.EQUIDISTANT else array.POLYNOMIAL
    out[array.PICTURE_R2] = float(np.interp(angle, angles, radii)) ** 2
    return out


def usable(camera: FloatArray, pixels: Pixels) -> BoolArray:
    """(N,) whether the lens model of a camera array is valid at (N, 2) pixels; other pixels are masked."""
    from vsx_ros.kernels import lens as array

    plane = (pixels - camera[array.CX : array.CY + 1]) / camera[array.FX : array.FY + 1]
    return np.asarray((plane**2).sum(axis=1) <= camera[array.PICTURE_R2])


KINECT_SHUTTER = Shutter(0.026, 0.015)  # its colour camera at 30 Hz, indoors


def nominal_camera(width: int, height: int) -> PinholeCamera:
    """An uncalibrated Kinect's RGB camera (525 px at 640 columns, as ROS' own default), for images of any size [px]."""
    focal = 525.0 * width / 640.0
    return PinholeCamera(width=width, height=height, fx=focal, fy=focal, cx=0.5 * (width - 1), cy=0.5 * (height - 1))


def check_calibration(camera: PinholeCamera, T_base_cam: SE3 | None) -> None:
    """Raises CalibrationError for an impossible field of view, principal point, distortion or mount."""
    again = "check the calibration file or calibrate the camera again"
    half = 0.5 * camera.width / camera.fx
    fisheye = camera.model == lens.EQUIDISTANT
    view_deg = math.degrees(2.0 * (half if fisheye else math.atan(half)))
    most_deg = FISHEYE_VIEW_MAX_DEG if fisheye else VIEW_MAX_DEG
    if not VIEW_MIN_DEG <= view_deg <= most_deg or not 0.5 <= camera.fx / camera.fy <= 2.0:
        raise CalibrationError(
            f"focal lengths fx {camera.fx:g}, fy {camera.fy:g} px make a view of {view_deg:.3g} deg at "
            f"{camera.width} columns; {VIEW_MIN_DEG:g} to {most_deg:g} deg are possible: {again}"
        )
    if not (0.0 < camera.cx < camera.width and 0.0 < camera.cy < camera.height):
        raise CalibrationError(
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies outside the image of "
            f"{camera.width}x{camera.height}: {again}"
        )
    u, v = ((np.arange(16) + 0.5) * size / 16 - 0.5 for size in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    # The outermost pixels of a real lens may lie outside the valid range of its model; most of the image may not.
    if not usable(kernel_camera(camera), pixels).mean() > 0.5:
        fold_deg = math.degrees(lens.fold_angle(camera.model, camera.distortion))
        raise CalibrationError(
            f"the distortion {camera.distortion} ({camera.model}) holds up to {fold_deg:.0f} deg off the axis, so it "
            f"cannot be undone over most of the image: {again}"
        )
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
