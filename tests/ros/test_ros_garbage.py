"""Messages that lie reach live nodes; the nodes say so and go on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Pose, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import Image
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

SPEEDS = Twist(linear=Vector3(x=math.inf))
UPRIGHT = PoseWithCovariance(pose=Pose(orientation=Quaternion(w=1.0)))
GREY = 640 * 480 * b"\x80"
LIES = [
    (topics.ODOM, Odometry(), "pose message holds"),  # a quaternion of length zero
    (topics.ODOM, Odometry(pose=UPRIGHT, twist=TwistWithCovariance(twist=SPEEDS)), "odometry message holds speeds inf"),
    (topics.ODOM, Odometry(pose=UPRIGHT), "a stamp"),  # an hour ahead, as all of these
    (topics.IMAGE, Image(width=640, height=480, encoding="mono8", step=640, data=b"short"), "image of 640x480 mono8"),
    (topics.IMAGE, Image(width=640, height=480, encoding="mono8", step=640, data=GREY), "a stamp"),
    (topics.MAP, OccupancyGrid(), "map message says 0x0 cells"),
    (topics.SLAM_STATE, DiagnosticStatus(name="CONFUSED"), "SLAM state 'CONFUSED' is unknown"),
    (topics.TRAJECTORY, MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()]), "trajectory message: "),
]
"""Topic, message, and how the complaint begins."""


def test_nodes_survive_messages_that_lie(stack: Stack) -> None:
    stack.wait_until_driving()
    for topic, lie, words in LIES:
        if hasattr(lie, "header"):
            lie.header.stamp = rospy.Time.now() + rospy.Duration.from_sec(3600.0)
        publisher = rospy.Publisher(f"/{topic}", type(lie), queue_size=5)
        stack.wait(publisher.get_num_connections, f"listeners of {topic}")
        complaint = f"{topic}: {words}"
        said = stack.logs().count(complaint)
        # Again and again: one complaint soon after another is not logged.
        while_it_lies = rospy.Timer(rospy.Duration.from_sec(0.1), lambda _, lie=lie, to=publisher: to.publish(lie))
        try:
            stack.wait(lambda text=complaint, said=said: stack.logs().count(text) > said, complaint)
        finally:
            while_it_lies.shutdown()
        publisher.unregister()
    assert stack.dead() == []
    assert "bad callback" not in stack.logs()
    stack.wait_until_driving()
