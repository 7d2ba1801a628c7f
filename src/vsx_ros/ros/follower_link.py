"""What move_base and the follower say to each other, on move_base's side."""

import time

import rospy
from nav_msgs.msg import Path as PathMsg
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.navigation.follower import FollowerReport, decode_report
from vsx_ros.navigation.goal_execution import Follow
from vsx_ros.ros import topics, trajectory_messages
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.ros.planning_thread import path_msg


class FollowerLink:
    """Subscribers: follower/status. Publishers: move_base/global_plan, move_base/trajectory. report: the newest."""

    def __init__(self) -> None:
        self.report, self._report_s = FollowerReport(0, FollowStatus.IDLE, "", topics.MAP_FRAME), 0.0
        self._path_pub = rospy.Publisher(topics.GLOBAL_PLAN, PathMsg, queue_size=1, latch=True)
        self._trajectory_pub = rospy.Publisher(topics.TRAJECTORY, MultiDOFJointTrajectory, queue_size=2, latch=True)
        subscribe(topics.FOLLOWER_STATUS, String, self._on_report, queue_size=5, tcp_nodelay=True)

    def _on_report(self, msg: String) -> None:
        self.report, self._report_s = decode_report(msg.data), time.monotonic()

    @property
    def age_s(self) -> float:
        """Of the newest report [s]."""
        return time.monotonic() - self._report_s

    def follow(self, act: Follow) -> None:
        """Drive along this."""
        self._path_pub.publish(path_msg(act.way.plan, act.frame))
        self._trajectory_pub.publish(trajectory_messages.trajectory_msg(act.way.trajectory, act.frame, act.identity))

    def brake(self, now_ns: int, a_m_s2: float) -> None:
        """Stop on the way; infinite: stop at once, and there is nothing to follow any longer."""
        self._trajectory_pub.publish(trajectory_messages.brake_msg(a_m_s2, topics.MAP_FRAME, now_ns))
