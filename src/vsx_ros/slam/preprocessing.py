"""Checks and preprocesses each frame: image, rolling shutter, stamp, odometry."""

import math
from collections.abc import Callable

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config.maps import ShutterConfig, SlamConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera, Shutter, check_calibration, kernel_camera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import JOINED_NS, Frame, Odometry
from vsx_ros.slam.keyframe import HANGS, FrameData
from vsx_ros.slam.repeat_watch import RepeatWatch
from vsx_ros.vision.corners import CornerDetector, no_corners
from vsx_ros.vision.patch_search import moving
from vsx_ros.vision.pyramid import LEVELS, BlurDetector, Pyramid, build_pyramid, small_image

GAP_S, MAX_AGE_S = 1.0, 0.25  # between frames before it is reported; between odometry and image


def shutter_of(camera: PinholeCamera, config: ShutterConfig) -> Shutter:
    """From the configuration, else from the calibration; if unknown, all rows are exposed at once."""
    readout_s, exposure_s = camera.shutter or Shutter(0.0, 0.0)
    return Shutter(
        readout_s if config.readout_s < 0.0 else config.readout_s,
        exposure_s if config.exposure_s < 0.0 else config.exposure_s,
    )


def middle_s(camera: PinholeCamera, config: ShutterConfig) -> float:
    """From the start of the first row's exposure to the middle of the middle row's [s]."""
    return 0.5 * sum(shutter_of(camera, config))


def camera_twist(T_base_cam: SE3, odometry: Odometry) -> FloatArray:
    """(6,) rotation vector [rad/s] and velocity [m/s] of the camera in its own frame, at a reading's speeds."""
    forward, left, _ = T_base_cam.translation.tolist()
    turn = np.array([0.0, 0.0, odometry.omega])
    way = np.array([odometry.v - odometry.omega * left, odometry.omega * forward, 0.0])
    R_cam_base = T_base_cam.rotation.T
    return np.concatenate([R_cam_base @ turn, R_cam_base @ way])


class RollingShutter:
    """Rolling shutter of a camera on wheels. Poses of the map and odometry refer to the middle of the middle row's
    exposure, ``middle_ns`` after the stamp."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: ShutterConfig) -> None:
        self._standing = kernel_camera(camera)
        self._T_base_cam = T_base_cam
        self._readout_s, _ = shutter_of(camera, config)
        self._middle_s = middle_s(camera, config)
        self.middle_ns = round(1e9 * self._middle_s)

    def exposure(self, odometry: Odometry | None) -> tuple[FloatArray, SE3]:
        """For an image taken at the speed of an odometry reading (without one, at rest): the kernels' array (CAMERA,),
        and the camera at the stamp as seen from the middle."""
        if odometry is None or self._T_base_cam is None:
            return self._standing, SE3.identity()
        back = SE2.exp(-odometry.v * self._middle_s, -odometry.omega * self._middle_s)
        motion = camera_twist(self._T_base_cam, odometry) * self._readout_s
        return moving(self._standing, motion), self._T_base_cam.inverse() @ SE3.from_se2(back) @ self._T_base_cam


class Preprocessor:
    """``take`` one frame after the other. T_middle_stamp: the camera at the latest frame's stamp, seen from the middle
    of its exposure. repeats: whether the latest image shows nothing of now (see ``RepeatWatch``). gap: called with
    (stamp_ns, reason) at a gap in time, images or odometry.

    Raises CalibrationError for an impossible camera or mount."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, gap: Callable[[int, str], None]
    ) -> None:
        check_calibration(camera, T_base_cam)
        self._camera = camera
        self._gap = gap
        self._shutter = RollingShutter(camera, T_base_cam, config.shutter)
        self.T_middle_stamp = SE3.identity()
        self._odometry = None if T_base_cam is None else ContinuousOdometry(gap)
        self._detector = CornerDetector(config.tracker.corners)
        self._blur = BlurDetector()
        self._last_stamp_ns: int | None = None
        self._repeats, self.repeats = RepeatWatch(), False

    def take(self, frame: Frame, odometry: Odometry | None, *, metric: bool) -> FrameData:
        """The next frame. metric: whether the map has a scale; without one, odometry only tells frozen images. Raises
        InputError for an image of the wrong size or type and a stamp that does not advance; nothing has changed then.
        """
        pyramid = build_pyramid(frame.image)
        self._check(frame)
        last = self._last_stamp_ns
        if last is not None and (frame.stamp_ns - last) * 1e-9 > GAP_S:
            self._gap(frame.stamp_ns, f"no frame for {(frame.stamp_ns - last) * 1e-9:.1f} s")
        self._last_stamp_ns = frame.stamp_ns
        middle_ns = frame.stamp_ns + self._shutter.middle_ns
        T_odom_base = self._odometry.at(middle_ns, odometry) if self._odometry is not None and metric else None
        array, self.T_middle_stamp = self._shutter.exposure(odometry if T_odom_base is not None else None)
        small = small_image(pyramid)
        placed = None if odometry is None else pose_at(middle_ns, odometry)
        where = (placed, odometry.odom_epoch) if odometry is not None and isinstance(placed, SE2) else None
        self.repeats = self._repeats.see(middle_ns, pyramid, where)
        frozen = self.repeats and _shows_light(pyramid)
        if frozen:
            self._gap(frame.stamp_ns, f"the image is the last one to the bit though the base moves: {HANGS}")
        blurred = not frozen and self._blur.blurred(pyramid)
        corners = no_corners(pyramid) if frozen else self._detector.detect(pyramid, steer=not blurred)
        return FrameData(
            stamp_ns=frame.stamp_ns,
            image=pyramid,
            corners=corners,
            small=small,
            T_odom_base=T_odom_base,
            camera=array,
            blurred=blurred,
            frozen=frozen,
        )

    def _check(self, frame: Frame) -> None:
        """Raise InputError for an image of another size, and a stamp that does not advance."""
        camera, last = self._camera, self._last_stamp_ns
        if frame.image.shape != (camera.height, camera.width):
            height, width = frame.image.shape
            raise InputError(
                f"image of {width}x{height} does not fit the calibration for {camera.width}x{camera.height}; "
                "calibrate at this size or set the camera to the calibrated one"
            )
        if last is not None and frame.stamp_ns <= last:
            raise InputError(
                f"frame stamp {frame.stamp_ns} ns is not after the one before, {last} ns; frames must come in order"
            )

    def begins_again(self, odometry: Odometry | None) -> bool:
        """See ``ContinuousOdometry``; for frames before the map."""
        return self._odometry is not None and odometry is not None and self._odometry.begins_again(odometry)

    def parted(self) -> bool:
        """See ``ContinuousOdometry``."""
        return self._odometry is not None and self._odometry.parted()


def _shows_light(pyramid: Pyramid) -> bool:
    coarse = pyramid.level(LEVELS - 1)
    return bool(coarse.min() < coarse.max())


def pose_at(stamp_ns: int, odometry: Odometry) -> SE2 | str:
    """T_odom_base at the time of an image, extrapolated from a reading; or why that is impossible, in words."""
    age = (stamp_ns - odometry.stamp_ns) * 1e-9
    if reason := odometry.impossible or _out_of_date(age):
        return reason
    return odometry.T_odom_base @ SE2.exp(odometry.v * age, odometry.omega * age)


class ContinuousOdometry:
    """Call ``at`` for each image. gap: called with (stamp_ns, reason) when a reading cannot be used as it is."""

    def __init__(self, gap: Callable[[int, str], None]) -> None:
        self._gap = gap
        self._last: tuple[int, SE2, int] | None = None
        self._T_continuous_odom, self._parted = SE2(), False

    def begins_again(self, odometry: Odometry) -> bool:
        """Whether a new epoch begins with this reading. If so, forget the one before: its poses are counted on only
        from a map."""
        if self._last is None or self._last[2] == odometry.odom_epoch:
            return False
        self._last, self._T_continuous_odom, self._parted = None, SE2(), False
        return True

    def parted(self) -> bool:
        """Whether since the last call an epoch began of which nobody knows where."""
        parted, self._parted = self._parted, False
        return parted

    def at(self, stamp_ns: int, odometry: Odometry | None) -> SE2 | None:
        """The pose of the base by odometry at the time of the image, None when unknown.

        A new epoch does not move the base: it is assumed to have moved at the speed of the reading, and counting
        continues from there. After a longer silence than that can be true for, it is assumed to have stood."""
        if odometry is None:
            return None
        raw = pose_at(stamp_ns, odometry)
        if isinstance(raw, str):
            self._gap(stamp_ns, f"{raw}: ignored for this frame")
            return None
        counted = self._T_continuous_odom @ raw
        if self._last is not None and self._last[2] != odometry.odom_epoch:
            last_ns, last, _ = self._last
            elapsed, far = (stamp_ns - last_ns) * 1e-9, stamp_ns - last_ns > JOINED_NS
            jump = f"{last.distance_to(counted):.2f} m and {math.degrees(abs(last.angle_to(counted))):.0f} deg"
            how = ", as if the base had stood" if far else ""
            self._gap(stamp_ns, f"odometry jumped by {jump} in {elapsed:.2f} s: counted on from where it was{how}")
            counted = last if far else last @ SE2.exp(odometry.v * elapsed, odometry.omega * elapsed)
            self._parted |= far
            self._T_continuous_odom = counted @ raw.inverse()
        self._last = stamp_ns, counted, odometry.odom_epoch
        return counted


def _out_of_date(age: float) -> str:
    if abs(age) <= MAX_AGE_S:
        return ""
    return f"odometry is {abs(age):.2f} s {'older' if age > 0.0 else 'newer'} than the image"
