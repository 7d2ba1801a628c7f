"""Subscribers and services that survive unusable messages, with suitable queue lengths."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import rospy
from diagnostic_msgs.srv import AddDiagnostics, AddDiagnosticsRequest, AddDiagnosticsResponse
from genpy import Message
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from vsx_hw.errors import DeviceError
from vsx_ros.errors import InputError, VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.view import view_rad
from vsx_ros.limits import json_tree
from vsx_ros.robot import Odometry, OdometryEpochs, OperatorHold, PoseSpeeds
from vsx_ros.ros import convert, headers, images, logs, threads, topics

# Larger than any image: with rospy's default of 64 kB, a slow callback gets images one second late (ros_comm #536).
IMAGE_BUFFER_BYTES = 2**24

# Two seconds of odometry. A gap of one second looks like a restarted base, even if only this process was asleep.
ODOMETRY_QUEUE = 100

_ONCE_S = 1e9
_REPEAT_S = 5.0  # minimum time between equal complaints
_REFUSAL_S = 3.0  # so long a refusal tells why a topic has nothing to offer
_refusals: dict[str, tuple[float, str]] = {}  # topic -> when (monotonic), and why


def subscribe(
    topic: str, kind: type[Message], callback: Callable[[Any], None], *, queue_size: int, **options: Any
) -> rospy.Subscriber:
    """Subscribe. An unusable message is dropped and logged, at most every few seconds."""

    def guarded(msg: Any) -> None:
        try:
            callback(msg)
        except VsxError as error:
            remember_refusal(topic, str(error))
            if logs.due(topic, _REPEAT_S):
                rospy.logerr("%s: %s", topic, error)
        except rospy.ROSException:
            if not threads.is_ending():
                raise

    return rospy.Subscriber(topic, kind, guarded, queue_size=queue_size, **options)


def remember_refusal(topic: str, reason: str) -> None:
    """A message of a topic came, but cannot be used."""
    _refusals[topic] = time.monotonic(), reason


def refusal(topic: str, since_s: float = -math.inf) -> str:
    """The topic's name and why its last unusable message was refused, if that was after since_s (monotonic) and within
    three seconds; else empty. Who misses messages must not say that none come."""
    refused_s, reason = _refusals.get(topic, (-math.inf, ""))
    if refused_s <= max(since_s, time.monotonic() - _REFUSAL_S):
        return ""
    return f"{rospy.resolve_name(topic)}: {reason}"


def json_object(msg: String, *names: str) -> dict[str, Any]:
    """The JSON object in a String. names: keys that it must have. Raises InputError for anything else."""
    try:
        value = json_tree(msg.data)
    except ValueError as error:
        raise InputError(f"{msg.data[:80]!r} is not JSON: {error}") from error
    if not isinstance(value, dict) or not value.keys() >= set(names):
        raise InputError(f"{msg.data[:80]!r} is not a JSON object{' with ' * bool(names)}{', '.join(names)}")
    return value


def json_number(tree: Mapping[str, Any], name: str, most: float, unit: str) -> float:
    """The number of this name in a tree of JSON. Raises InputError for anything else, and beyond -most to most."""
    value = tree[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
        raise InputError(f"{name} is a number from {-most:g} to {most:g} {unit}, not {value!r:.40}")
    return float(value)


def image_subscriber(callback: Callable[[Image], None]) -> rospy.Subscriber:
    """Subscribe to the camera so that the newest image, not a buffered one, arrives."""
    return subscribe(topics.IMAGE, Image, callback, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)


def hear_odometry(callback: Callable[[Odometry], None], topic: str = topics.ODOM, first_epoch: int = 0) -> None:
    """Subscribe so that every reading arrives, with its epoch, even on a machine that was busy for a moment.
    first_epoch: the first epoch number. Messages hold no epoch: each process counts its own, by the same rule from the
    same readings, and never compares it with others. So a process may start late. Speeds that the driver leaves 0 are
    those of its poses."""
    epochs, speeds = OdometryEpochs(first_epoch), PoseSpeeds()

    def take(msg: OdometryMsg) -> None:
        told = convert.odometry(msg)
        headers.refuse_future(told.stamp_ns)
        odometry = speeds.of(told)
        if odometry != told and logs.due(f"speeds of {topic}", _ONCE_S):
            rospy.logwarn("%s moves but tells no speeds: those of its poses are used; let its driver fill twist", topic)
        callback(epochs.enter(odometry))

    subscribe(topic, OdometryMsg, take, queue_size=ODOMETRY_QUEUE, tcp_nodelay=True)


def hear_view(callback: Callable[[float], None]) -> None:
    """Subscribe to the camera's field of view [rad], by the calibration that comes with its images; told when that
    changes."""
    known: PinholeCamera | None = None

    def take(msg: CameraInfo) -> None:
        nonlocal known
        before, known = known, images.our_camera(msg)
        if known != before:
            callback(view_rad(known))

    subscribe(topics.CAMERA_INFO, CameraInfo, take, queue_size=1)


def hear_operator_hold(callback: Callable[[OperatorHold | None], None]) -> rospy.Subscriber:
    """Subscribe to the fact that the operator holds the wheels; None: nobody does."""

    def take(msg: String) -> None:
        told = json_object(msg, "by", "since_ns")
        if not isinstance(told["by"], str) or type(told["since_ns"]) is not int:
            raise InputError(f"{msg.data[:80]!r} names nobody who holds the wheels; is another node publishing it?")
        callback(OperatorHold(told["by"], told["since_ns"]) if told["by"] else None)

    return subscribe(topics.OPERATOR_HOLD, String, take, queue_size=5, tcp_nodelay=True)


def offer_text(name: str, act: Callable[[str], str]) -> None:
    """Offer a service that takes a text, usually JSON (AddDiagnostics, a standard type). ``act`` returns the answer's
    message, or raises VsxError."""

    def answer(request: AddDiagnosticsRequest) -> AddDiagnosticsResponse:
        try:
            return AddDiagnosticsResponse(success=True, message=act(request.load_namespace))
        except VsxError as error:
            return AddDiagnosticsResponse(success=False, message=str(error))

    rospy.Service(name, AddDiagnostics, answer)


def offer_trigger(name: str, act: Callable[[], str]) -> None:
    """Offer a service without arguments. ``act`` returns the answer's message, or raises VsxError or DeviceError."""
    offer_trigger_by(name, lambda _: act())


def offer_trigger_by(name: str, act: Callable[[str], str]) -> None:
    """The same; ``act`` is told the name of the node that asks."""

    def answer(request: TriggerRequest) -> TriggerResponse:
        try:
            return TriggerResponse(True, act(getattr(request, "_connection_header", {}).get("callerid", "")))
        except (VsxError, DeviceError) as error:
            return TriggerResponse(False, str(error))

    rospy.Service(name, Trigger, answer)
