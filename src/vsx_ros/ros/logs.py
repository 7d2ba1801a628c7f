"""A node's reports: /diagnostics, and logs that never raise, never wait for the master and do not repeat themselves."""

import logging
import math
import os
import threading
import time
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager
from pathlib import Path

import rospy
import rospy.impl.paramserver
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from vsx_hw.errors import DeviceError
from vsx_hw.readings import LinkStatus
from vsx_ros.errors import VsxError, disk_trouble
from vsx_ros.ros import calls, threads, topics
from vsx_ros.runs import process

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_OMITS_TOPICS = "/rosout_disable_topics_generation"
_REPEAT_S = 30.0  # minimum time between equal errors

logger = logging.getLogger(__name__)
_said_s: dict[str, float] = {}
_saying = threading.Lock()


def quiet_failures() -> None:
    """Errors while logging never end the node, and calls to the master never block it forever."""
    process.never_fail()
    os.environ.setdefault("ROS_PYTHON_LOG_CONFIG_FILE", str(Path(__file__).with_name("python_logging.conf")))
    calls.bound_master_calls()


def bridge_logging() -> None:
    """Send the loggers of the core and of the drivers to the screen and to /rosout, like rospy's own logger."""
    rosout = logging.getLogger("rosout")
    for name in ("vsx_ros", "vsx_hw"):
        logging.getLogger(name).parent = rosout


def log_without_master() -> None:
    """Call once per node. Unless this entry is cached, rospy asks the master for it with every logged line. A hanging
    master would then block the driver of the wheels and the emergency stop, too."""
    kept = rospy.impl.paramserver.get_param_server_cache()
    kept.set(_OMITS_TOPICS, bool(rospy.get_param(_OMITS_TOPICS, False)))


def due(what: str, period_s: float) -> bool:
    """Whether ``what`` was last due at least this long ago; limits repeated messages. Unlike rospy's throttle, it also
    works while ROS time stands still."""
    now_s = time.monotonic()
    with _saying:
        is_due = now_s - _said_s.get(what, -math.inf) > period_s
        if is_due:
            _said_s[what] = now_s
    return is_due


def attempt(last: Callable[[], None]) -> None:
    """Do one of the last steps of a node. Log its failure, so that the next step is still done."""
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
    """Log a VsxError from inside, at most every 30 s, and continue: for work that the robot can do without."""
    try:
        yield
    except VsxError as error:
        if due("errors", _REPEAT_S):
            rospy.logerr("%s", error)


class Diagnostics:
    """Publishes the last known state of the node's components once a second (REP 107), and a new error at once."""

    def __init__(self, hardware_id: str = "") -> None:
        self._hardware_id = hardware_id or rospy.get_name()
        self._components: dict[str, tuple[int, str, dict[str, str]]] = {}
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher(topics.DIAGNOSTICS, DiagnosticArray, queue_size=5)
        threads.every(1.0, "diagnostics", self._publish)

    def set(self, component: str, level: int, message: str, **values: object) -> None:
        """Replace the state of a component; ``values`` become key-value strings."""
        with self._lock:
            before = self._components.get(component)
            self._components[component] = (level, message, {k: str(v) for k, v in values.items()})
        if level == ERROR and before is not None and before[0] != ERROR:
            self._publish({component})

    def device(self, component: str, status: LinkStatus, **values: object) -> None:
        """Report the link to a device. If the driver's thread has ended, raises DeviceError, which ends the node."""
        if not status.alive:
            raise DeviceError(f"{status.device}: the driver's thread has ended; the node begins again")
        level = OK if status.connected else ERROR
        self.set(component, level, status.message, device=status.device, **values, **status.counters)

    def _publish(self, only: Container[str] | None = None) -> None:
        array = DiagnosticArray()
        array.header.stamp = rospy.Time.now()
        node = rospy.get_name().lstrip("/")
        with self._lock:
            for component, (level, message, values) in self._components.items():
                if only is not None and component not in only:
                    continue
                pairs = [KeyValue(key, value) for key, value in values.items()]
                array.status.append(DiagnosticStatus(level, f"{node}: {component}", message, self._hardware_id, pairs))
        self._publisher.publish(array)
