"""Where the robot is, as every node but vslam knows it: wheels at 30 Hz and more, corrected by the camera."""

from __future__ import annotations

import math
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry as OdometryMsg

from vsx_ros.control.pose_fusion import PoseFuser
from vsx_ros.control.stuck import Stuck
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, process, slam_messages, topics
from vsx_ros.slam.state import TrackingState


class Localization:
    """Subscribers: odom, vslam/pose, vslam/state. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._fuser = PoseFuser()
        self._odometry: Odometry | None = None
        self._taken_s = -math.inf
        self.slam_state = TrackingState.NOT_INITIALISED
        self.slam_reason = "waiting for vslam"
        process.odometry_subscriber(self._on_odometry)
        process.subscribe(topics.POSE, PoseWithCovarianceStamped, self._on_pose, queue_size=5, tcp_nodelay=True)
        process.subscribe(topics.SLAM_STATE, DiagnosticStatus, self._on_state, queue_size=5, tcp_nodelay=True)

    def _on_odometry(self, msg: OdometryMsg) -> None:
        odometry = convert.odometry(msg)
        process.refuse_future(odometry.stamp_ns)
        with self._lock:
            if self._fuser.add_odometry(odometry):
                self._odometry, self._taken_s = odometry, time.monotonic()

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        stamp_ns = msg.header.stamp.to_nsec()
        process.refuse_future(stamp_ns)
        with self._lock:
            self._fuser.add_slam(stamp_ns, convert.se2(msg.pose.pose))

    def _on_state(self, msg: DiagnosticStatus) -> None:
        self.slam_state, self.slam_reason = slam_messages.tracking_state(msg), msg.message

    @property
    def is_tracking(self) -> bool:
        """Whether the camera knows where it is."""
        return self.slam_state.tracked

    def pose(self, frame: str) -> SE2 | None:
        """T_frame_base in 'map' or 'odom'; None while unknown."""
        if frame == topics.ODOM_FRAME:
            return self._odometry.T_odom_base if self._odometry is not None else None
        with self._lock:
            return self._fuser.pose()

    @property
    def wheels(self) -> tuple[SE2 | None, int]:
        """T_odom_base, None while unknown, and how often the wheels began to count until then."""
        with self._lock:
            return self._odometry.T_odom_base if self._odometry is not None else None, self._fuser.countings

    @property
    def wheels_silent_s(self) -> float:
        """For how long no odometry came that could be used [s], on the monotonic clock; infinite before the first."""
        return time.monotonic() - self._taken_s

    def age_s(self, now_ns: int) -> float:
        """Age of the image behind the newest camera pose [s]; infinite before the first."""
        with self._lock:
            return self._fuser.slam_age_s(now_ns)

    @property
    def stuck(self) -> Stuck | None:
        """How the wheels turn although the camera stands; None when they do not."""
        with self._lock:
            return self._fuser.stuck

    @property
    def stands(self) -> bool:
        """Whether the wheels report that they stand."""
        return self._odometry is not None and self._odometry.stands
