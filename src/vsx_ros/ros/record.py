"""The recorder behind ``vsx record``: writes a ROS 1 bag message by message, named .active until it is complete."""

import argparse
import io
import os
import queue
import shutil
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import rospy
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError
from sensor_msgs.msg import CompressedImage, Image

from vsx_ros.errors import InputError
from vsx_ros.ros import headers, images, operator_command, topics
from vsx_ros.ros.callbacks import IMAGE_BUFFER_BYTES, subscribe
from vsx_ros.runs.process import DONE, FAILED, Progress, SignalFlag

_TOPICS = (
    topics.CAMERA_INFO, topics.SHUTTER, topics.ODOM, topics.ODOM_FACTORS, topics.TF, topics.TF_STATIC, topics.IMU,
    topics.HAZARDS, topics.BUTTONS, topics.BATTERY, topics.MUX_ACTIVE, topics.OPERATOR_HOLD,
    topics.COMMAND_SAFETY, topics.COMMAND_TELEOP, topics.COMMAND_NAVI, topics.POSE, topics.SLAM_STATE,
    topics.EXPLORE_STATUS, topics.EXPLORE_EVENTS, topics.DIAGNOSTICS, topics.GLOBAL_PLAN, topics.PLAN_MS,
    topics.COVERAGE, topics.ZONES, topics.ROOMS, *(f"{topics.STATS}/{name}" for name in topics.STAT_TYPES),
)  # fmt: skip
_NEEDED = (topics.IMAGE, topics.CAMERA_INFO, topics.ODOM)
_CAMERA_WAIT_S = 20.0  # for the first image; then recording begins all the same
_WARN_AFTER_S, _TICK_S = 3.0, 0.1  # without a message; so that Ctrl-C takes effect at once
_ENCODING = {"png": [cv2.IMWRITE_PNG_COMPRESSION, 1], "jpeg": [cv2.IMWRITE_JPEG_QUALITY, 90]}  # of 9 and of 100
_WAITING = 500  # Messages that may wait for the disk: 150 MB of raw images
_STUCK_S = 30.0  # After this long without progress, stop waiting for the disk
_OVERHEAD_BYTES = 64  # of a record's header and index, about


class Serialized(NamedTuple):
    """A message in its serialized form. said: the connection header sent by its publisher."""

    topic: str
    stamp_ns: int
    said: Mapping[str, str]
    data: bytes


class BagWriter:
    """Writes on its own thread. ``put`` never waits; ``close`` writes the index and renames the bag. Raises InputError
    if the file cannot be created. ``failure`` gives the reason if writing ended early."""

    def __init__(self, path: Path) -> None:
        self._path, self._active = path, path.with_name(f"{path.name}.active")
        self.counts = Counter[str]()
        self.bytes, self.dropped, self.failure = 0, 0, ""
        self._connections: dict[tuple[str, ...], object] = {}
        self._queue: queue.Queue[Serialized | None] = queue.Queue(_WAITING)
        try:
            self._writer = Writer(self._active)
            self._writer.open()
        except (OSError, WriterError) as error:
            raise InputError(f"bag {path} cannot be written ({error}); choose another name or folder") from error
        self._thread = threading.Thread(target=self._write, name="bag", daemon=True)
        self._thread.start()

    def put(self, message: Serialized) -> None:
        """Queue the message for writing; if the queue is full, drop and count it."""
        try:
            self._queue.put_nowait(message)
        except queue.Full:
            self.dropped += 1

    def close(self) -> Path:
        """Finish and return the bag's path. An empty bag is deleted."""
        told, seen = False, -1
        while self._thread.is_alive() and seen != self.bytes:
            seen = self.bytes
            with suppress(queue.Full):
                if not told:
                    self._queue.put(None, timeout=_STUCK_S)
                told = True
                self._thread.join(_STUCK_S)
        if self._thread.is_alive():
            self.failure = self.failure or f"it took nothing for {_STUCK_S:g} s"
            return self._active
        try:
            if not self.counts:
                self._active.unlink(missing_ok=True)
            elif not self.failure:
                os.replace(self._active, self._path)
                return self._path
        except OSError as error:
            self.failure = self.failure or str(error)
        return self._active

    def _write(self) -> None:
        while (message := self._queue.get()) is not None:
            if self.failure:
                continue
            try:
                self._writer.write(self._connection(message), message.stamp_ns, message.data)  # type: ignore[arg-type]  # bytes will do
            except Exception as error:  # catch everything: without this thread, close would wait forever
                self.failure = str(error) or repr(error)
                continue
            self.counts[message.topic] += 1
            self.bytes += len(message.data) + _OVERHEAD_BYTES
        try:
            self._writer.close()
        except Exception as error:  # a bag without its index must not get its final name
            self.failure = self.failure or str(error) or repr(error)

    def _connection(self, message: Serialized) -> object:
        """The connection for this topic and publisher, made at its first message."""
        said = message.said
        key = message.topic, said["type"], said.get("callerid", "")
        if key not in self._connections:
            self._connections[key] = self._writer.add_connection(
                message.topic,
                said["type"].replace("/", "/msg/"),
                msgdef=said.get("message_definition", ""),
                md5sum=said["md5sum"],
                callerid=said.get("callerid", ""),
                latching=int(said.get("latching") == "1"),
            )
        return self._connections[key]


class Recorder:
    """Subscribes to all topics and passes messages to the writer unchanged; images in the chosen format."""

    def __init__(self, writer: BagWriter, how: str, more: list[str]) -> None:
        self._writer, self._how, self._frames = writer, how, images.Frames()
        wanted = (*_TOPICS, *more, *((topics.IMAGE,) if how == "raw" else ()))
        for name in dict.fromkeys(map(rospy.resolve_name, wanted)):
            rospy.Subscriber(name, rospy.AnyMsg, self._on_any, name, buff_size=IMAGE_BUFFER_BYTES)
        if how != "raw":
            subscribe(topics.IMAGE, Image, self._on_image, queue_size=5, buff_size=IMAGE_BUFFER_BYTES)

    def _on_any(self, msg: Any, topic: str) -> None:
        self._writer.put(Serialized(topic, headers.now_ns(), msg._connection_header, msg._buff))

    def _on_image(self, msg: Image) -> None:
        """Store it grey, as the SLAM sees it. Raises InputError for an unusable image."""
        gray = self._frames.of(msg).image
        good, content = cv2.imencode(".png" if self._how == "png" else ".jpg", gray, _ENCODING[self._how])
        if not good:
            raise InputError(f"image of {gray.shape[1]}x{gray.shape[0]} cannot be encoded; record with --images raw")
        packed, data = CompressedImage(msg.header, self._how, content.tobytes()), io.BytesIO()
        packed.serialize(data)
        topic = f"{rospy.resolve_name(topics.IMAGE)}/compressed"
        said = {"type": packed._type, "md5sum": packed._md5sum, "message_definition": packed._full_text}
        self._writer.put(Serialized(topic, headers.now_ns(), {**said, "callerid": "/vsx_record"}, data.getvalue()))


@operator_command.command
def record(args: argparse.Namespace) -> int:
    """Record until Ctrl-C or a limit; print the bag's name and contents. args: options of ``vsx record``."""
    path: Path = args.out or Path(f"{datetime.now():%Y-%m-%d_%H-%M-%S}.bag")
    if full := _full(args, path):
        raise InputError(f"not begun with {full}; make room, or give another --out or a smaller --keep-free")
    operator_command.join("record")
    ended = SignalFlag(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    _await_camera(ended, progress := Progress(sys.stderr))
    writer = BagWriter(path)
    Recorder(writer, args.images, args.topic)
    began_s, warned = time.monotonic(), False
    reason = ""
    while not ended.came and not reason:
        time.sleep(_TICK_S)
        elapsed_s = time.monotonic() - began_s
        reason = _limit(args, writer, elapsed_s, path)
        if not warned and elapsed_s > _WARN_AFTER_S:
            warned = True
            for name in map(rospy.resolve_name, [topic for topic in _NEEDED if not _heard(writer, topic)]):
                progress.say(f"nothing arrives on {name}; 'rostopic info {name}' shows who publishes it")
        if progress.is_due:
            progress.show(f"{elapsed_s:5.0f} s  {writer.bytes / 1e6:.0f} MB  {_heard(writer)} images  Ctrl-C ends it")
    elapsed_s = time.monotonic() - began_s
    rospy.signal_shutdown("recorded")
    path = writer.close()
    progress.say(reason or "ended by the operator")
    return _say(writer, path, elapsed_s)


def _await_camera(ended: SignalFlag, progress: Progress) -> None:
    """Wait for the first image, but not forever: a recording may be of something else."""
    came: list[object] = []
    listener = rospy.Subscriber(topics.IMAGE, rospy.AnyMsg, came.append, queue_size=1, buff_size=IMAGE_BUFFER_BYTES)
    deadline_s = time.monotonic() + _CAMERA_WAIT_S
    while not (came or ended.came or rospy.is_shutdown()) and time.monotonic() < deadline_s:
        time.sleep(_TICK_S)
        if progress.is_due:
            progress.show(f"waiting for the first image on {rospy.resolve_name(topics.IMAGE)}; Ctrl-C ends it")
    listener.unregister()


def _limit(args: argparse.Namespace, writer: BagWriter, elapsed_s: float, path: Path) -> str:
    """Why recording must end now, or empty."""
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
    """The free disk space if it is less than required, else empty."""
    try:
        free = shutil.disk_usage(path.resolve().parent).free
    except OSError as error:
        return f"{path.parent} out of reach ({error.strerror})"
    few = free < args.keep_free.bytes
    return f"{free / 1e9:.1f} GB left on the disk (--keep-free {args.keep_free.text})" if few else ""


def _heard(writer: BagWriter, topic: str = topics.IMAGE) -> int:
    name = rospy.resolve_name(topic)
    return writer.counts[name] + writer.counts[f"{name}/compressed"]


def _say(writer: BagWriter, path: Path, elapsed_s: float) -> int:
    """Print the result. A bag without images counts as failure."""
    if not writer.counts:
        sys.stderr.write("vsx: nothing was heard, so there is no bag; is a robot running? 'vsx status' tells\n")
        return FAILED
    dropped = f", {writer.dropped} messages dropped because the disk is too slow" if writer.dropped else ""
    sys.stdout.write(
        f"{path}: {elapsed_s:.1f} s, {_heard(writer)} images, {sum(writer.counts.values())} messages, "
        f"{writer.bytes / 1e6:.1f} MB{dropped}\n"
    )
    if writer.failure:
        return FAILED
    if not _heard(writer):
        sys.stderr.write(
            "vsx: the bag has no image and cannot be replayed; is the camera running? 'vsx status' tells\n"
        )
        return FAILED
    sys.stdout.write(f"  vsx replay {path} --map\n")
    return DONE
