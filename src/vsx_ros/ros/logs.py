"""Logging that never fails, never waits for the master, and does not repeat itself."""

import logging
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import rospy
import rospy.impl.paramserver

from vsx_ros.errors import VsxError, disk_trouble
from vsx_ros.ros import calls
from vsx_ros.runs import process

_OMITS_TOPICS = "/rosout_disable_topics_generation"
_REPEAT_S = 30.0  # the same trouble at most so often

logger = logging.getLogger(__name__)
_said_s: dict[str, float] = {}
_saying = threading.Lock()


def quiet_failures() -> None:
    """What a node says never ends it, and what it asks the master never holds it for ever."""
    process.never_fail()
    os.environ.setdefault("ROS_PYTHON_LOG_CONFIG_FILE", str(Path(__file__).with_name("python_logging.conf")))
    calls.bound_master_calls()


def bridge_logging() -> None:
    """Send the loggers of the core and of the drivers to the screen and to /rosout, as rospy's own."""
    rosout = logging.getLogger("rosout")
    for name in ("vsx_ros", "vsx_hw"):
        logging.getLogger(name).parent = rosout


def log_without_master() -> None:
    """Once a node: rospy asks the master for this entry with every line that is logged, unless it is set; a master that
    hangs would hold whoever logs, the driver of the wheels and the emergency stop among them."""
    kept = rospy.impl.paramserver.get_param_server_cache()
    kept.set(_OMITS_TOPICS, bool(rospy.get_param(_OMITS_TOPICS, False)))


def due(what: str, period_s: float) -> bool:
    """Whether ``what`` was not due for so long: to say something now and then, also while ROS time stands, which
    rospy's own throttle goes by."""
    now_s = time.monotonic()
    with _saying:
        is_due = now_s - _said_s.get(what, -math.inf) > period_s
        if is_due:
            _said_s[what] = now_s
    return is_due


def attempt(last: Callable[[], None]) -> None:
    """Do one of the last things of a node; log what goes wrong, so that the next is done all the same."""
    try:
        last()
    except VsxError as error:
        rospy.logerr("%s", error)
    except Exception as error:
        if isinstance(error, OSError) and disk_trouble(error):
            rospy.logerr("%s", disk_trouble(error))
        else:
            logger.exception("%s failed", last.__qualname__)


@contextmanager
def log_errors() -> Iterator[None]:
    """Log what goes wrong inside, now and then, and end nothing: for work the robot can do without."""
    try:
        yield
    except VsxError as error:
        if due("errors", _REPEAT_S):
            rospy.logerr("%s", error)
