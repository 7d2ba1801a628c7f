"""Subscribers that outlive a bad message, with queues as long as what they hear needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rospy
from genpy import Message
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

from vsx_ros.errors import VsxError
from vsx_ros.ros import logs, threads, topics

# Bigger than any image: with rospy's default of 64 kB a slow callback sees images of a second ago (ros_comm #536).
IMAGE_BUFFER_BYTES = 2**24

# Two seconds of odometry: a second without it looks like a base that was restarted, though only this process slept.
ODOMETRY_QUEUE = 100

_REPEAT_S = 5.0


def subscribe(
    topic: str, kind: type[Message], callback: Callable[[Any], None], *, queue_size: int, **options: Any
) -> rospy.Subscriber:
    """Subscribe; a message that cannot be used is dropped and named, at most every few seconds."""

    def guarded(msg: Any) -> None:
        try:
            callback(msg)
        except VsxError as error:
            if logs.due(topic, _REPEAT_S):
                rospy.logerr("%s: %s", topic, error)
        except rospy.ROSException:
            if not threads.is_ending():
                raise

    return rospy.Subscriber(topic, kind, guarded, queue_size=queue_size, **options)


def image_subscriber(callback: Callable[[Image], None]) -> rospy.Subscriber:
    """Subscribe to the camera so that the newest image, not a buffered one, arrives."""
    return subscribe(topics.IMAGE, Image, callback, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)


def odometry_subscriber(callback: Callable[[Odometry], None], topic: str = topics.ODOM) -> rospy.Subscriber:
    """Subscribe to odometry so that every reading arrives, on a machine that was busy for a moment, too."""
    return subscribe(topic, Odometry, callback, queue_size=ODOMETRY_QUEUE, tcp_nodelay=True)
