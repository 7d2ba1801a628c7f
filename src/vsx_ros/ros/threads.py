"""Threads of a node: if one fails, the node ends; when the node ends, all of them end."""

import logging
import threading
import time
from collections.abc import Callable

import rospy
import rospy.core

from vsx_hw.errors import DeviceError
from vsx_ros.errors import VsxError

logger = logging.getLogger(__name__)


def is_ending() -> bool:
    """Whether the node is about to end: topics close and reject messages before ``rospy.is_shutdown`` is true."""
    return bool(rospy.core.is_shutdown_requested())


_failures: list[Exception] = []


def exit_code() -> int:
    """Of a node that ends: 0, or if one of its threads failed 1, and 2 if the device was the reason."""
    return 0 if not _failures else 2 if isinstance(_failures[0], DeviceError) else 1


def worker(name: str, loop: Callable[[], None]) -> threading.Thread:
    """Run ``loop`` on a thread. If it raises, the node logs the reason and ends with an exit code, to be started
    again: a node with a dead thread looks alive to all others, which is worse than a dead node."""

    def guarded() -> None:
        try:
            loop()
        except Exception as error:
            if isinstance(error, rospy.ROSException) and is_ending():
                return  # topics close while threads still run
            _failures.append(error)
            if isinstance(error, VsxError | DeviceError):
                rospy.logfatal("%s", error)
            else:
                logger.exception("thread %r failed", name)
            rospy.signal_shutdown(f"thread {name!r} failed: {error}")

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread


def every(period_s: float, name: str, step: Callable[[], None]) -> threading.Thread:
    """Call ``step`` on a new thread every ``period_s`` seconds until ROS shuts down. Uses the monotonic clock: ROS time
    may stand still, and the safety checks would then stop, too."""

    def loop() -> None:
        due_s = time.monotonic()
        while not is_ending():
            step()
            due_s = max(due_s + period_s, time.monotonic())  # missed steps are skipped
            time.sleep(max(0.0, due_s - time.monotonic()))

    return worker(name, loop)


def join(thread: threading.Thread, within_s: float) -> bool:
    """Wait for a thread of the node; whether it ended. True at once if the thread calls this for itself."""
    if thread is threading.current_thread():
        return True
    thread.join(within_s)
    return not thread.is_alive()
