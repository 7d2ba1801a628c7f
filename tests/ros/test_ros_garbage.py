"""Messages that lie reach live nodes; the nodes say so and go on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import Image
from std_msgs.msg import UInt8
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

LIES = [
    (topics.ODOM, Odometry()),  # a quaternion of length zero
    (topics.IMAGE, Image(width=640, height=480, encoding="mono8", step=640, data=b"short")),
    (topics.MAP, OccupancyGrid()),  # no cells
    (topics.SLAM_STATE, DiagnosticStatus(name="CONFUSED")),
    (topics.TRAJECTORY, MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()])),
    (topics.HAZARDS, UInt8(0)),
]


def test_nodes_survive_messages_that_lie(stack: Stack) -> None:
    stack.wait_until_driving()
    infinite = Odometry()
    infinite.pose.pose.orientation.w = 1.0
    infinite.twist.twist.linear.x = math.inf
    grey = 640 * 480 * b"\x80"
    early = Image(width=640, height=480, encoding="mono8", step=640, data=grey)
    soon = Odometry()
    soon.pose.pose.orientation.w = 1.0
    early.header.stamp = soon.header.stamp = rospy.Time.now() + rospy.Duration.from_sec(3600.0)
    for topic, lie in [*LIES, (topics.ODOM, infinite), (topics.IMAGE, early), (topics.ODOM, soon)]:
        publisher = rospy.Publisher(f"/{topic}", type(lie), queue_size=5)
        stack.wait(lambda p=publisher: p.get_num_connections() > 0, f"listeners of {topic}")
        for _ in range(3):
            publisher.publish(lie)
        rospy.sleep(0.2)
        publisher.unregister()
    assert stack.dead() == []
    assert "bad callback" not in stack.logs()
    assert "image 640x480 mono8" in stack.logs()
    stack.wait_until_driving()
