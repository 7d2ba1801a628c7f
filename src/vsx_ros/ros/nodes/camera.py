"""Node ``camera``: images and their calibration.

Subscribers: none; with ros:TOPIC that topic and its camera_info.
Publishers: camera/rgb/image_raw (bayer_grbg8 or mono8), camera/rgb/camera_info with the same stamps,
    camera/rgb/shutter (latched: readout and exposure [s], empty if unknown).
Services: camera/rgb/set_camera_info (stores the calibration where the node reads it).
Parameters: ~device (kinect): kinect, kinect:SERIAL, v4l:N or v4l:PATH (of /dev/videoN, or a link to it as in
    /dev/v4l/by-id), emulator:SOCKET or ros:TOPIC.
    ~camera_info_url (""): file with the calibration; default $ROS_HOME/camera_info/rgb_SERIAL.yaml, for an emulated
    camera SOCKET.yaml; after that file comes the newest camera_info of ros:TOPIC (of rectified images before it). What
    has another size than the images does not count; without any, nominal values with a warning.
    ~frame_id (camera_rgb_optical_frame). ~mode (vga): of a Kinect, vga (30 Hz), uyvy (15 Hz) or sxga (1280x1024,
    10 Hz); of v4l:N size, rate and format, e.g. 1280x720@30/mjpeg or 640x480/yuyv. ~lock_exposure (true): a Kinect or
    v4l:N locks exposure and white balance after two seconds; set false if the light differs much from room to room.
    ~latency_s (0): of v4l:N, from the start of exposure to the driver's stamp, taken off the stamps that it publishes;
    what is left of it, of any camera, is slam.shutter.latency_s."""

import rospy
from sensor_msgs.msg import CameraInfo, Image
from sensor_msgs.srv import SetCameraInfo, SetCameraInfoRequest, SetCameraInfoResponse
from std_msgs.msg import Float64MultiArray

from vsx_hw.readings import ImageReading
from vsx_ros.config import Config
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.ros import headers, images, node, threads, topics
from vsx_ros.ros.cameras import CameraCalibration, open_camera
from vsx_ros.ros.logs import OK, WARN, Diagnostics


class CameraNode:
    """The driver's thread publishes; a timer reports health."""

    def __init__(self, config: Config) -> None:
        self._device = str(rospy.get_param("~device", "kinect"))
        self._frame_id = str(rospy.get_param("~frame_id", headers.own(topics.OPTICAL_FRAME)))
        self._calibration = CameraCalibration(self._device, str(rospy.get_param("~camera_info_url", "")))
        self._readout_s = config.slam.shutter.readout_s
        self._frames_reported = 0
        self._image_pub = rospy.Publisher(topics.IMAGE, Image, queue_size=5, tcp_nodelay=True)
        self._info_pub = rospy.Publisher(topics.CAMERA_INFO, CameraInfo, queue_size=5, tcp_nodelay=True)
        self._shutter_pub = rospy.Publisher(topics.SHUTTER, Float64MultiArray, queue_size=1, latch=True)
        rospy.Service(topics.SET_CAMERA_INFO, SetCameraInfo, self._on_set_camera_info)
        mode, lock_exposure = str(rospy.get_param("~mode", "vga")), bool(rospy.get_param("~lock_exposure", True))
        latency_s = float(rospy.get_param("~latency_s", 0.0))
        self._told: PinholeCamera | None = None
        self._source = open_camera(self._device, self._on_image, mode, lock_exposure, latency_s)
        self._diagnostics = Diagnostics(self._device)
        threads.every(1.0, "health", self._report)
        self._source.start()

    def _on_image(self, reading: ImageReading) -> None:
        height, width = reading.image.shape
        camera = self._calibration.of(self._source, width, height)
        if camera != self._told:
            self._told = camera
            self._shutter_pub.publish(images.shutter_msg(camera.shutter))
        self._info_pub.publish(images.camera_info(camera, reading.stamp_ns, self._frame_id))
        self._image_pub.publish(images.image_msg(reading.stamp_ns, reading.image, reading.encoding, self._frame_id))

    def _on_set_camera_info(self, request: SetCameraInfoRequest) -> SetCameraInfoResponse:
        try:
            path = self._calibration.store(self._source, images.camera(request.camera_info))
        except (CalibrationError, OSError) as error:
            return SetCameraInfoResponse(False, str(error))
        return SetCameraInfoResponse(True, f"stored in {path}")

    def _report(self) -> None:
        status = self._source.status()
        rate_hz = status.counters["frames"] - self._frames_reported
        self._frames_reported += rate_hz
        if status.connected and rate_hz <= 0:
            status = status._replace(connected=False, message="no images")
        self._diagnostics.device("stream", status, rate_hz=rate_hz)
        known = self._calibration.known
        remedy = "calibrated" if known else "not calibrated; run 'vsx calibrate camera --live'"
        if self._told is not None and self._told.shutter is None and self._readout_s < 0.0:
            remedy += "; its shutter is not known and taken as global, run 'vsx calibrate shutter'"
        self._diagnostics.set("calibration", OK if known else WARN, remedy)

    def close(self) -> None:
        """Stop the stream."""
        self._source.close()


def main() -> None:
    """Entry point of scripts/camera."""
    node.run("camera", CameraNode)
