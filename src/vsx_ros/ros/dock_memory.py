"""The node vslam remembers where the base charged, in its map."""

import rospy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool

from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, headers, topics
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.session import SlamSession
from vsx_ros.slam.snapshot import MapSnapshot


class DockMemory:
    """Subscribers: mobile_base/docked. Publishers: dock/pose (latched: where the base stands when it charges; in the
    map, so it moves with its keyframes)."""

    def __init__(self, session: SlamSession) -> None:
        self._session = session
        self._docked = self._is_new = False
        self._told: SE2 | None = None
        self._pose_pub = rospy.Publisher(topics.DOCK_POSE, PoseStamped, queue_size=1, latch=True)
        subscribe(topics.DOCKED, Bool, self._on_docked, queue_size=5)

    def _on_docked(self, msg: Bool) -> None:
        self._is_new = bool(msg.data) and not self._docked
        self._docked = bool(msg.data)

    def publish(self, snapshot: MapSnapshot) -> None:
        """Remember a new contact as soon as the base knows where it is; publish the dock if it is new or moved."""
        odometry = self._session.where.odometry
        T_map_base = None if odometry is None else self._session.base_at(odometry)
        if self._is_new and self._docked and T_map_base is not None:
            self._is_new = False
            self._session.ground.docked(T_map_base)
        docked = self._session.ground.dock(snapshot)
        if docked is not None and docked != self._told:
            self._told = docked
            self._pose_pub.publish(convert.pose_stamped(topics.MAP_FRAME, headers.now_ns(), docked))
