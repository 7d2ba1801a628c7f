"""Subscribers and services that outlive what they cannot use, with queues as long as what they hear needs."""

from collections.abc import Callable
from typing import Any

import rospy
from genpy import Message
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import Image
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from vsx_hw.errors import DeviceError
from vsx_ros.errors import InputError, VsxError
from vsx_ros.limits import json_tree
from vsx_ros.robot import Odometry, OdometryEpochs
from vsx_ros.ros import convert, headers, logs, threads, topics

# Bigger than any image: with rospy's default of 64 kB a slow callback sees images of a second ago (ros_comm #536).
IMAGE_BUFFER_BYTES = 2**24

# Two seconds of odometry: a second without it looks like a base that was restarted, though only this process slept.
ODOMETRY_QUEUE = 100

_REPEAT_S = 5.0  # the same complaint at most so often


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


def json_object(msg: String, *names: str) -> dict[str, Any]:
    """The object in a String of JSON. names: what it must have. Raises InputError for anything else."""
    try:
        value = json_tree(msg.data)
    except ValueError as error:
        raise InputError(f"{msg.data[:80]!r} is not JSON: {error}") from error
    if not isinstance(value, dict) or not value.keys() >= set(names):
        raise InputError(f"{msg.data[:80]!r} is not a JSON object{' with ' * bool(names)}{', '.join(names)}")
    return value


def image_subscriber(callback: Callable[[Image], None]) -> rospy.Subscriber:
    """Subscribe to the camera so that the newest image, not a buffered one, arrives."""
    return subscribe(topics.IMAGE, Image, callback, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)


def hear_odometry(callback: Callable[[Odometry], None], topic: str = topics.ODOM, first_epoch: int = 0) -> None:
    """Subscribe so that every reading arrives, with its epoch, on a machine that was busy for a moment, too.
    first_epoch: the one to begin with. Messages hold no epoch: each process counts its own, by one rule from the same
    readings, compares it with no other process's, and so needs nobody who was there from the beginning."""
    epochs = OdometryEpochs(first_epoch)

    def take(msg: OdometryMsg) -> None:
        odometry = convert.odometry(msg)
        headers.refuse_future(odometry.stamp_ns)
        callback(epochs.enter(odometry))

    subscribe(topic, OdometryMsg, take, queue_size=ODOMETRY_QUEUE, tcp_nodelay=True)


def offer_trigger(name: str, act: Callable[[], str]) -> None:
    """A service without arguments: ``act`` returns the message of its answer, or raises VsxError or DeviceError."""

    def answer(_: TriggerRequest) -> TriggerResponse:
        try:
            return TriggerResponse(True, act())
        except (VsxError, DeviceError) as error:
            return TriggerResponse(False, str(error))

    rospy.Service(name, Trigger, answer)
