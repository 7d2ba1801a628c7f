"""Where the camera puts the base, as a pose and in the tf tree."""

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf2_msgs.msg import TFMessage

from vsx_ros.config import MountConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros import clock, convert, threads, topics
from vsx_ros.session import SlamSession
from vsx_ros.slam.state import TrackingResult, TrackingState

_TF_PERIOD_S = 0.05
_TF_TOLERANCE_NS = 100_000_000
# What tracking of this quality achieves against a metric map; the SLAM states no covariance of its own.
_SIGMA = {TrackingState.GOOD: (0.02, 0.01), TrackingState.DUBIOUS: (0.06, 0.03)}
_DISTRUST = 10.0


class PosePublisher:
    """Publishers: vslam/pose (base_footprint in map, stamp of the image), /tf map -> odom, /tf_static (camera, gyro).
    Parameters: ~publish_tf (bool, true; false: somebody else, an EKF, says where odom is in map)."""

    def __init__(self, session: SlamSession, mount: MountConfig) -> None:
        self._session = session
        self._T_cam_base = session.T_base_cam.inverse()
        self._pose_pub = rospy.Publisher(topics.POSE, PoseWithCovarianceStamped, queue_size=5, tcp_nodelay=True)
        if rospy.get_param("~publish_tf", True):
            self._tf_pub = rospy.Publisher(topics.TF, TFMessage, queue_size=20)
            threads.every(_TF_PERIOD_S, "tf", self._publish_tf)
        self._tf_static_pub = rospy.Publisher(topics.TF_STATIC, TFMessage, queue_size=1, latch=True)
        self._tf_static_pub.publish(convert.mount_transforms(mount, clock.now_ns()))

    def publish(self, result: TrackingResult, odometry: Odometry | None) -> None:
        """The pose of a tracked frame."""
        if result.T_world_cam is None or result.state not in _SIGMA:
            return
        T_map_base = (result.T_world_cam @ self._T_cam_base).to_se2()
        sigma_m, sigma_rad = _SIGMA[result.state]
        if result.found == 0 and odometry is not None and not odometry.trusted:  # by odometry that nobody vouches for
            sigma_m, sigma_rad = _DISTRUST * sigma_m, _DISTRUST * sigma_rad
        sigmas = sigma_m, sigma_rad
        self._pose_pub.publish(convert.pose_with_covariance(topics.MAP_FRAME, result.stamp_ns, T_map_base, *sigmas))

    def _publish_tf(self) -> None:
        stamp_ns, T_map_odom = clock.now_ns() + _TF_TOLERANCE_NS, self._session.T_map_odom or SE2()
        self._tf_pub.publish([convert.transform_stamped(topics.MAP_FRAME, topics.ODOM_FRAME, stamp_ns, T_map_odom)])
