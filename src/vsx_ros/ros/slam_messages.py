"""Output of the SLAM: its state, numbers to plot, the pose of the base, and the camera picture with features."""

import threading
import time
from collections.abc import Callable

import cv2
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from genpy.message import get_message_class
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from vsx_ros.arrays import ColorImage, FloatArray, Pixels
from vsx_ros.config import MountConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.limits import MIB
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import convert, headers, logs, threads, topics
from vsx_ros.ros.logs import ERROR, OK, Diagnostics
from vsx_ros.session import SlamSession
from vsx_ros.slam.snapshot import MapSnapshot, TrackedFeatures
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.slam.uncertainty import carried

_FPS_MEMORY = 0.1  # weight of the newest frame in the mean
_AGAIN_S = 10.0  # minimum time between equal messages
_TF_PERIOD_S = 0.05  # with the tolerance, listeners never wait for it
_TF_TOLERANCE_NS = 100_000_000  # transforms are stamped this far ahead, as in amcl
_DISTRUST = 10.0  # factor on the standard deviations when only untrusted odometry gives the pose
_PREVIEW_PERIOD_S = 0.1
_QUALITY_PERCENT = 70
_FOUND_BGR, _MISSED_BGR = (90, 220, 60), (60, 60, 235)
_FOUND_PX, _MISSED_PX = 4, 3


class SlamStatus:
    """Publishers: vslam/state (latched, on change and with every map), vslam/stats/*, /diagnostics."""

    def __init__(self) -> None:
        self._stats = {
            name: rospy.Publisher(f"{topics.STATS}/{name}", get_message_class(kind), queue_size=10)
            for name, kind in topics.STAT_TYPES.items()
        }
        self._state_pub = rospy.Publisher(topics.SLAM_STATE, DiagnosticStatus, queue_size=5, latch=True)
        self._diagnostics = Diagnostics()
        self._state, self._reason = TrackingState.NOT_INITIALISED, "waiting for the first image"
        self._fps, self._ahead, self._stuck = 0.0, "", ""
        self.announce()

    def waiting_for(self, topic: str, trouble: str = "") -> None:
        """Report a missing message on a required topic; before the map it is why there is none. trouble: why those that
        come cannot be used."""
        name = rospy.resolve_name(topic)
        reason = trouble or f"no message on {name}; 'rostopic info {name}' shows who publishes it"
        self._diagnostics.set("input", ERROR, reason)
        if self._state is TrackingState.NOT_INITIALISED:
            self._change(self._state, reason)
        if logs.due("waiting", _AGAIN_S):
            rospy.logwarn("%s", reason)

    def without_images(self, trouble: str) -> None:
        """No image came for a while: the camera's pose is not known now, but tracking is not lost yet. trouble: why
        those that come cannot be used; empty if none comes."""
        state = TrackingState.DUBIOUS if self._state is TrackingState.GOOD else self._state
        self._change(state, trouble or "no image comes")

    def camera_changed(self) -> None:
        """Report another calibration than the one in use."""
        reason = "the camera's calibration has changed, but vslam uses the one before; start vslam anew, in a new map"
        self._diagnostics.set("calibration", ERROR, reason)
        if logs.due("calibration", _AGAIN_S):
            rospy.logerr("%s", reason)

    def refused(self, reason: str) -> None:
        """Report an unusable image."""
        self._diagnostics.set("input", ERROR, reason)
        if logs.due("refused", _AGAIN_S):
            rospy.logerr("%s", reason)

    def frame(self, result: TrackingResult, period_s: float, dropped: int, stuck: str) -> None:
        """Report a tracked frame, ``period_s`` after the previous one; ``dropped`` counts the skipped frames. stuck: in
        words, that the wheels turn although the camera stands."""
        self._fps += _FPS_MEMORY * (1.0 / max(period_s, 1e-3) - self._fps)
        self._change(result.state, result.reason, result.ahead, stuck)
        self._diagnostics.set("input", OK, f"{self._fps:.0f} images a second", dropped=dropped)
        self._publish(
            tracked_ratio=result.found / max(result.searched, 1),
            tracked=result.found,
            attempted=result.searched,
            fps=self._fps,
            latency_ms=(headers.now_ns() - result.stamp_ns) * 1e-6,
            dropped=dropped,
        )

    def map(self, snapshot: MapSnapshot, map_bytes: int, dense_bytes: int) -> None:
        """Publish the size of the map, also in memory; called once a second."""
        keyframes, points, map_mib = len(snapshot.T_world_cams), len(snapshot.points_world), map_bytes / MIB
        self._diagnostics.set("map", OK, f"{keyframes} keyframes, {points} points, {map_mib:.0f} MiB")
        self._publish(keyframes=keyframes, points=points, map_mib=map_mib, dense_mib=dense_bytes / MIB)

    def _change(self, state: TrackingState, reason: str, ahead: str = "", stuck: str | None = None) -> None:
        stuck = self._stuck if stuck is None else stuck  # without images the wheels cannot be judged anew
        if (state, reason, ahead, stuck) != (self._state, self._reason, self._ahead, self._stuck):
            if state is not self._state:
                rospy.loginfo("%s: %s", state.word, reason)
            self._state, self._reason, self._ahead, self._stuck = state, reason, ahead, stuck
            self.announce()

    def announce(self) -> None:
        """Publish the state."""
        msg = convert.state_msg(self._state, self._reason, self._ahead, self._stuck)
        self._state_pub.publish(msg)
        self._diagnostics.set("tracking", msg.level, f"{msg.name} {msg.message}".strip())

    def _publish(self, **values: float) -> None:
        for name, value in values.items():
            self._stats[name].publish(value)


class PosePublisher:
    """Publishers: vslam/pose (base_footprint in map, stamp of the image), /tf map -> odom, /tf_static (camera, gyro).
    Parameters: ~publish_tf (bool, true; false: another node, e.g. an EKF, publishes odom in map)."""

    def __init__(self, session: SlamSession, mount: MountConfig) -> None:
        self._session = session
        self._T_cam_base = session.T_base_cam.inverse()
        self._pose_pub = rospy.Publisher(topics.POSE, PoseWithCovarianceStamped, queue_size=5, tcp_nodelay=True)
        if rospy.get_param("~publish_tf", True):
            self._tf_pub = rospy.Publisher(topics.TF, TFMessage, queue_size=20)
            threads.every(_TF_PERIOD_S, "tf", self._publish_tf)
        self._tf_static_pub = rospy.Publisher(topics.TF_STATIC, TFMessage, queue_size=1, latch=True)
        self._tf_static_pub.publish(convert.mount_transforms(mount, headers.now_ns()))

    def publish(self, result: TrackingResult, odometry: Odometry | None) -> None:
        """Publish the pose of a tracked frame."""
        if result.T_world_cam is None or result.covariance is None or not result.state.tracked:
            return
        T_map_base = (result.T_world_cam @ self._T_cam_base).to_se2()
        covariance = carried(result.covariance, self._T_cam_base)
        if result.found == 0 and odometry is not None and not odometry.trusted:
            covariance = _DISTRUST**2 * covariance
        self._pose_pub.publish(located(result.stamp_ns, T_map_base, covariance))

    def _publish_tf(self) -> None:
        stamp_ns, T_map_odom = headers.now_ns() + _TF_TOLERANCE_NS, self._session.T_map_odom or SE2()
        self._tf_pub.publish([convert.transform_stamped(topics.MAP_FRAME, topics.ODOM_FRAME, stamp_ns, T_map_odom)])


def located(stamp_ns: int, T_map_base: SE2, covariance: FloatArray) -> PoseWithCovarianceStamped:
    """A pose on the floor. covariance (6, 6): of translation and rotation in the base's axes. Height and tilt are
    marked unknown."""
    msg = PoseWithCovarianceStamped(header=headers.header(topics.MAP_FRAME, stamp_ns))
    msg.pose.pose = convert.pose_msg(T_map_base)
    msg.pose.covariance = convert.floor_covariance(T_map_base, covariance)
    return msg


class Preview:
    """Publishers: vslam/preview/compressed (JPEG, at most 10 Hz, while someone subscribes)."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher(topics.PREVIEW, CompressedImage, queue_size=1)
        self._shown_s = 0.0
        self._newest: tuple[Frame, TrackedFeatures | None] | None = None
        self._work = threading.Event()
        threads.worker("preview", self._draw)

    def show(self, frame: Frame, features: Callable[[], TrackedFeatures | None]) -> None:
        """Pass on a picture if someone listens and the period is over; another thread draws it."""
        if time.monotonic() - self._shown_s >= _PREVIEW_PERIOD_S and self._publisher.get_num_connections() > 0:
            self._shown_s = time.monotonic()
            self._newest = frame, features()
            self._work.set()

    def _draw(self) -> None:
        while not rospy.is_shutdown():
            if not self._work.wait(timeout=1.0):
                continue
            self._work.clear()
            assert self._newest is not None
            frame, features = self._newest
            _, jpeg = cv2.imencode(".jpg", drawn(frame, features), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY_PERCENT])
            header = headers.header(topics.OPTICAL_FRAME, frame.stamp_ns)
            self._publisher.publish(CompressedImage(header, "bgr8; jpeg compressed bgr8", jpeg.tobytes()))


def drawn(frame: Frame, features: TrackedFeatures | None) -> ColorImage:
    """The (H, W, 3) BGR picture: a green circle at each found point, a red cross at each missed one."""
    picture: ColorImage = cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
    if features is not None:
        for u, v in _pixels(features.missed):
            reach = _MISSED_PX
            cv2.line(picture, (u - reach, v - reach), (u + reach, v + reach), _MISSED_BGR)
            cv2.line(picture, (u - reach, v + reach), (u + reach, v - reach), _MISSED_BGR)
        for pixel in _pixels(features.found):
            cv2.circle(picture, pixel, _FOUND_PX, _FOUND_BGR)
    return picture


def _pixels(uv: Pixels) -> list[tuple[int, int]]:
    return [(round(u), round(v)) for u, v in uv.tolist()]
