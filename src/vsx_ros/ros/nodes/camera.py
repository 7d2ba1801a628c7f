"""Node ``camera``: images and their calibration.

Subscribers: none; with ros:TOPIC that topic and its camera_info.
Publishers: camera/rgb/image_raw (bayer_grbg8 or mono8), camera/rgb/camera_info with the same stamps.
Services: camera/rgb/set_camera_info (stores the calibration where the node reads it).
Parameters: ~device (kinect): kinect, kinect:SERIAL, v4l:N or emulator:SOCKET.
    ~camera_info_url (""): file with the calibration; without one $ROS_HOME/camera_info/rgb_SERIAL.yaml, for an emulated
    camera SOCKET.yaml, and if that is missing too nominal values with a warning.
    ~frame_id (camera_rgb_optical_frame). ~mode (vga): of a Kinect, vga (30 Hz), uyvy (15 Hz) or sxga (1280x1024,
    10 Hz). ~lock_exposure (true): a Kinect keeps exposure and white balance as they are after two seconds; give false
    where the light changes much from room to room.
"""

from __future__ import annotations

import os
from pathlib import Path

import rospy
from sensor_msgs.msg import CameraInfo, Image
from sensor_msgs.srv import SetCameraInfo, SetCameraInfoRequest, SetCameraInfoResponse

from vsx_hw.errors import DeviceError
from vsx_hw.readings import ImageReading
from vsx_ros.config import Config
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera, nominal_camera
from vsx_ros.io.calibration_file import read_calibration, write_calibration
from vsx_ros.ros import frames, images, node, threads, topics
from vsx_ros.ros.cameras import open_camera
from vsx_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics


class CameraNode:
    """The driver's thread publishes; a timer reports health."""

    def __init__(self, config: Config) -> None:
        self._device = str(rospy.get_param("~device", "kinect"))
        self._url = str(rospy.get_param("~camera_info_url", ""))
        self._frame_id = str(rospy.get_param("~frame_id", frames.own(topics.OPTICAL_FRAME)))
        self._calibration: PinholeCamera | None = None
        self._calibrated = False
        if self._url and not self._device.startswith("emulator:"):
            self._calibration, self._calibrated = read_calibration(_path(self._url)), True
        self._frames_reported = 0
        self._image_pub = rospy.Publisher(topics.IMAGE, Image, queue_size=5, tcp_nodelay=True)
        self._info_pub = rospy.Publisher(topics.CAMERA_INFO, CameraInfo, queue_size=5, tcp_nodelay=True)
        rospy.Service(topics.SET_CAMERA_INFO, SetCameraInfo, self._on_set_camera_info)
        self._source = open_camera(
            self._device,
            self._on_image,
            str(rospy.get_param("~mode", "vga")),
            bool(rospy.get_param("~lock_exposure", True)),
        )
        self._diagnostics = Diagnostics(self._device)
        threads.every(1.0, "health", self._report)
        self._source.start()

    def _on_image(self, reading: ImageReading) -> None:
        height, width = reading.image.shape
        camera = self._calibration or self._told_calibration() or self._find_calibration(width, height)
        if (camera.width, camera.height) != (width, height):
            rospy.logwarn("calibration is of %dx%d, images are %dx%d", camera.width, camera.height, width, height)
            camera, self._calibrated = nominal(self._device, width, height), False
        self._calibration = camera
        self._info_pub.publish(images.camera_info(camera, reading.stamp_ns, self._frame_id))
        self._image_pub.publish(images.image_msg(reading.stamp_ns, reading.image, reading.encoding, self._frame_id))

    def _told_calibration(self) -> PinholeCamera | None:
        """What the source itself says, if it says anything."""
        camera: PinholeCamera | None = getattr(self._source, "calibration", None)
        self._calibrated = self._calibrated or camera is not None
        return camera

    def _calibration_file(self) -> Path:
        if self._url:
            return _path(self._url)
        if self._device.startswith("emulator:"):
            return Path(self._device.partition(":")[2] + ".yaml")
        home = Path(os.environ.get("ROS_HOME", Path.home() / ".ros"))
        return home / "camera_info" / f"rgb_{self._source.serial}.yaml"

    def _find_calibration(self, width: int, height: int) -> PinholeCamera:
        path = self._calibration_file()
        try:
            camera = read_calibration(path)
        except CalibrationError as error:
            rospy.logwarn("camera is not calibrated: %s. Nominal values are used; expect a bent map", error)
            return nominal(self._device, width, height)
        self._calibrated = True
        return camera

    def _on_set_camera_info(self, request: SetCameraInfoRequest) -> SetCameraInfoResponse:
        path = self._calibration_file()
        try:
            camera = images.camera(request.camera_info)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_calibration(path, camera, path.stem)
        except (CalibrationError, OSError) as error:
            return SetCameraInfoResponse(False, str(error))
        self._calibration, self._calibrated = camera, True
        return SetCameraInfoResponse(True, f"stored in {path}")

    def _report(self) -> None:
        status = self._source.status()
        if not status.alive:
            raise DeviceError(f"{status.device}: the driver's thread has ended; the node begins anew")
        frames = status.counters["frames"]
        rate_hz, self._frames_reported = frames - self._frames_reported, frames
        alive = status.connected and rate_hz > 0
        message = status.message if alive or not status.connected else "no images"
        level = OK if alive else ERROR
        self._diagnostics.set("stream", level, message, rate_hz=rate_hz, device=status.device, **status.counters)
        if self._calibrated:
            self._diagnostics.set("calibration", OK, "calibrated")
        else:
            self._diagnostics.set("calibration", WARN, "not calibrated; run 'vsx calibrate camera --live'")

    def close(self) -> None:
        """Stop the stream."""
        self._source.close()


def nominal(device: str, width: int, height: int) -> PinholeCamera:
    """What is assumed of an uncalibrated camera. The 4:3 image of a Kinect is the upper part of its 1280 x 1024 one, so
    the centre lies above the middle of that."""
    if device.startswith(("v4l", "ros")):
        return nominal_camera(width, height)
    upper = nominal_camera(width, width * 3 // 4)
    return PinholeCamera(width, height, upper.fx, upper.fy, upper.cx, upper.cy)


def _path(url: str) -> Path:
    """A file from a file:// URL or a path; ${ROS_HOME} and ~ are expanded."""
    return Path(os.path.expandvars(url.removeprefix("file://"))).expanduser()


def main() -> None:
    """Entry point of scripts/camera."""
    node.run("camera", CameraNode)
