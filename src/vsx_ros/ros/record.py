"""The recorder behind ``vsx record``."""

import argparse
import io
import shutil
import signal
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import rospy
from sensor_msgs.msg import CompressedImage, Image

from vsx_ros.errors import InputError
from vsx_ros.ros import clock, images, operator_command, topics
from vsx_ros.ros.bag_writer import BagWriter, Serialized
from vsx_ros.ros.callbacks import IMAGE_BUFFER_BYTES, subscribe
from vsx_ros.ros.progress import Progress
from vsx_ros.runs.exit_codes import DONE, FAILED
from vsx_ros.runs.interruptible import SignalFlag

_TOPICS = (
    topics.CAMERA_INFO, topics.ODOM, topics.TF, topics.TF_STATIC, topics.IMU, topics.HAZARDS, topics.BUTTONS,
    topics.BATTERY, topics.MUX_ACTIVE, topics.COMMAND_SAFETY, topics.COMMAND_TELEOP, topics.COMMAND_NAVI, topics.POSE,
    topics.SLAM_STATE, topics.EXPLORE_STATUS, topics.EXPLORE_EVENTS, topics.DIAGNOSTICS, topics.GLOBAL_PLAN,
    topics.PLAN_MS, topics.COVERAGE, *(f"{topics.STATS}/{name}" for name in topics.STAT_TYPES),
)  # fmt: skip
_NEEDED = (topics.IMAGE, topics.CAMERA_INFO, topics.ODOM)
_WARN_AFTER_S = 3.0
_TICK_S = 0.1
_JPEG_QUALITY = 90
_ENCODING = {"png": [cv2.IMWRITE_PNG_COMPRESSION, 1], "jpeg": [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]}


class Recorder:
    """Subscribes to everything and hands it to the writer as it came; images as they are wanted."""

    def __init__(self, writer: BagWriter, how: str, more: list[str]) -> None:
        self._writer, self._how = writer, how
        wanted = (*_TOPICS, *more, *((topics.IMAGE,) if how == "raw" else ()))
        for name in dict.fromkeys(map(rospy.resolve_name, wanted)):
            rospy.Subscriber(name, rospy.AnyMsg, self._on_any, name, buff_size=IMAGE_BUFFER_BYTES)
        if how != "raw":
            subscribe(topics.IMAGE, Image, self._on_image, queue_size=5, buff_size=IMAGE_BUFFER_BYTES)

    def _on_any(self, msg: Any, topic: str) -> None:
        self._writer.put(Serialized(topic, clock.now_ns(), msg._connection_header, msg._buff))

    def _on_image(self, msg: Image) -> None:
        """Grey, as the SLAM sees it. Raises InputError for an image that cannot be used."""
        gray = images.frame(msg).image
        good, content = cv2.imencode(".png" if self._how == "png" else ".jpg", gray, _ENCODING[self._how])
        if not good:
            raise InputError(f"image of {gray.shape[1]}x{gray.shape[0]} cannot be encoded; record with --images raw")
        packed, data = CompressedImage(msg.header, self._how, content.tobytes()), io.BytesIO()
        packed.serialize(data)
        topic = f"{rospy.resolve_name(topics.IMAGE)}/compressed"
        said = {"type": packed._type, "md5sum": packed._md5sum, "message_definition": packed._full_text}
        self._writer.put(Serialized(topic, clock.now_ns(), {**said, "callerid": "/vsx_record"}, data.getvalue()))


@operator_command.command
def record(args: argparse.Namespace) -> int:
    """Record until Ctrl-C or a limit; say what the bag is called and what is in it. args: options of ``vsx record``."""
    path: Path = args.out or Path(f"{datetime.now():%Y-%m-%d_%H-%M-%S}.bag")
    if full := _full(args, path):
        raise InputError(f"not begun with {full}; make room, or give another --out or a smaller --keep-free")
    operator_command.join("record")
    ended = SignalFlag(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    writer, progress = BagWriter(path), Progress(sys.stderr)
    Recorder(writer, args.images, args.topic)
    began_s, warned = time.monotonic(), False
    reason = ""
    while not ended.came and not reason:
        time.sleep(_TICK_S)
        elapsed_s = time.monotonic() - began_s
        reason = _limit(args, writer, elapsed_s, path)
        if not warned and elapsed_s > _WARN_AFTER_S:
            warned = True
            for line in _missing(writer):
                progress.say(line)
        if progress.is_due:
            progress.show(f"{elapsed_s:5.0f} s  {writer.bytes / 1e6:.0f} MB  {_images(writer)} images  Ctrl-C ends it")
    elapsed_s = time.monotonic() - began_s
    rospy.signal_shutdown("recorded")
    path = writer.close()
    progress.say(reason or "ended by the operator")
    return _say(writer, path, elapsed_s)


def _limit(args: argparse.Namespace, writer: BagWriter, elapsed_s: float, path: Path) -> str:
    """Why it must end now, or nothing."""
    if writer.failure:
        return f"the disk took no more: {writer.failure}"
    if args.time is not None and elapsed_s >= args.time:
        return f"ended after {args.time:g} s"
    if writer.bytes >= args.limit.bytes:
        return f"ended at the limit of {args.limit.text}"
    if full := _full(args, path):
        return f"ended with {full}"
    return "" if not rospy.is_shutdown() else "ended, as the ROS master asked for it"


def _full(args: argparse.Namespace, path: Path) -> str:
    """What is left on the disk when that is less than wanted, or nothing."""
    try:
        free = shutil.disk_usage(path.resolve().parent).free
    except OSError as error:
        return f"{path.parent} out of reach ({error.strerror})"
    few = free < args.keep_free.bytes
    return f"{free / 1e9:.1f} GB left on the disk (--keep-free {args.keep_free.text})" if few else ""


def _images(writer: BagWriter) -> int:
    image = rospy.resolve_name(topics.IMAGE)
    return writer.counts.get(image, 0) + writer.counts.get(f"{image}/compressed", 0)


def _missing(writer: BagWriter) -> list[str]:
    names = [rospy.resolve_name(topic) for topic in _NEEDED]
    silent = [n for n in names if not (writer.counts.get(n) or writer.counts.get(f"{n}/compressed"))]
    return [f"nothing arrives on {name}; 'rostopic info {name}' shows who publishes it" for name in silent]


def _say(writer: BagWriter, path: Path, elapsed_s: float) -> int:
    """The result in words; a bag without images is no success."""
    if not writer.counts:
        sys.stderr.write("vsx: nothing was heard, so there is no bag; is a robot running? 'vsx status' tells\n")
        return FAILED
    dropped = f", {writer.dropped} messages dropped because the disk is too slow" if writer.dropped else ""
    sys.stdout.write(
        f"{path}: {elapsed_s:.1f} s, {_images(writer)} images, {sum(writer.counts.values())} messages, "
        f"{writer.bytes / 1e6:.1f} MB{dropped}\n"
    )
    if writer.failure:
        return FAILED
    if not _images(writer):
        sys.stderr.write(
            "vsx: the bag has no image and cannot be replayed; is the camera running? 'vsx status' tells\n"
        )
        return FAILED
    sys.stdout.write(f"  vsx replay {path} --map\n")
    return DONE
