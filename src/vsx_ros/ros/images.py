"""Converts camera messages to our types and back, without cv_bridge (its compiled part breaks under NumPy 2)."""

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Float64MultiArray, Header

from vsx_ros.arrays import ColorImage, GrayImage
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera, Shutter
from vsx_ros.io.calibration_file import camera_from_topic, shutter_from_topic
from vsx_ros.io.image_encoding import GrayImages
from vsx_ros.robot import Frame
from vsx_ros.ros import topics


class Frames:
    """The images of one camera, in order."""

    def __init__(self) -> None:
        self._gray = GrayImages()

    def of(self, msg: Image | CompressedImage, name: str = "image") -> Frame:
        """The grey image with its stamp. name: for messages. Raises InputError for an unknown encoding or a message
        with too few bytes."""
        stamp_ns, data = msg.header.stamp.to_nsec(), bytes(msg.data)
        if isinstance(msg, CompressedImage):
            return Frame(stamp_ns, self._gray.of_file(data, name, msg.format))
        shape, big_endian = (msg.height, msg.width, msg.step), bool(msg.is_bigendian)
        return Frame(stamp_ns, self._gray.of(msg.encoding, *shape, data, big_endian=big_endian, name=name))


def image_msg(stamp_ns: int, image: GrayImage | ColorImage, encoding: str, frame_id: str) -> Image:
    """The message of an (H, W) or (H, W, 3) uint8 array in the given encoding."""
    header = Header(stamp=rospy.Time(0, stamp_ns), frame_id=frame_id)
    height, width = image.shape[:2]
    return Image(header, height, width, encoding, 0, image.size // height, np.ascontiguousarray(image).tobytes())


def camera(msg: CameraInfo, image_topic: str = topics.IMAGE) -> PinholeCamera:
    """The calibration of the images of a topic. Raises CalibrationError for an uncalibrated camera, an unsupported lens
    model, or binned images."""
    if max(msg.binning_x, 1) != 1 or max(msg.binning_y, 1) != 1:
        raise CalibrationError(f"camera_info says binning {msg.binning_x}x{msg.binning_y}; publish unbinned images")
    size = msg.width, msg.height
    found = camera_from_topic(image_topic, size, msg.K, msg.D, msg.P, msg.distortion_model, "camera_info")
    if found is None:
        raise CalibrationError(
            "camera_info holds no calibration (K is zero); run 'vsx calibrate camera --live', or give a file to the "
            "camera node as ~camera_info_url"
        )
    return found


def our_camera(msg: CameraInfo) -> PinholeCamera:
    """That of the images; their topic may have another name here, which tells rectified ones."""
    return camera(msg, rospy.resolve_name(topics.IMAGE))


def shutter_msg(shutter: Shutter | None) -> Float64MultiArray:
    """Readout and exposure [s], which camera_info has no fields for; empty if unknown."""
    return Float64MultiArray(data=list(shutter or ()))


def shutter(msg: Float64MultiArray) -> Shutter | None:
    """None for no values. Raises CalibrationError unless there are 0 or 2 values."""
    return shutter_from_topic(msg.data, rospy.resolve_name(topics.SHUTTER))


def camera_info(camera: PinholeCamera, stamp_ns: int, frame_id: str) -> CameraInfo:
    """The message of a calibration, unrectified (R = identity, P = K)."""
    msg = CameraInfo(height=camera.height, width=camera.width, distortion_model=camera.model)
    msg.header = Header(stamp=rospy.Time(0, stamp_ns), frame_id=frame_id)
    msg.D, msg.K, msg.R = list(camera.distortion), camera.K.ravel().tolist(), np.eye(3).ravel().tolist()
    msg.P = np.column_stack([camera.K, np.zeros(3)]).ravel().tolist()
    return msg
