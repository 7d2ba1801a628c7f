"""Where the robot is, as every node but vslam knows it: odometry at 30 Hz and more, corrected by the camera."""

import math
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped

from vsx_ros.control.localization import Localization, LocalizationState
from vsx_ros.robot import Odometry
from vsx_ros.ros import clock, convert, slam_messages, topics
from vsx_ros.ros.callbacks import hear_odometry, subscribe


class LocalizationSubscriber:
    """A ``Localization`` fed by topics. Subscribers: odom, vslam/pose, vslam/state. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._localization = Localization()
        self._taken_s = -math.inf
        hear_odometry(self._on_odometry)
        subscribe(topics.POSE, PoseWithCovarianceStamped, self._on_pose, queue_size=5, tcp_nodelay=True)
        subscribe(topics.SLAM_STATE, DiagnosticStatus, self._on_state, queue_size=5, tcp_nodelay=True)

    def _on_odometry(self, odometry: Odometry) -> None:
        with self._lock:
            if self._localization.add_odometry(odometry):
                self._taken_s = time.monotonic()

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        stamp_ns = msg.header.stamp.to_nsec()
        clock.refuse_future(stamp_ns)
        with self._lock:
            self._localization.add_pose(stamp_ns, convert.se2(msg.pose.pose))

    def _on_state(self, msg: DiagnosticStatus) -> None:
        state = slam_messages.tracking_state(msg)
        with self._lock:
            self._localization.add_state(state, msg.message)

    def at(self, now_ns: int) -> LocalizationState:
        """What is known now."""
        with self._lock:
            return self._localization.at(now_ns)

    @property
    def odometry_age_s(self) -> float:
        """For how long no odometry came that could be used [s], on the monotonic clock; infinite before the first."""
        return time.monotonic() - self._taken_s
