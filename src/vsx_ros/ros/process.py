"""What every node does alike: start, configuration, logging, diagnostics, workers, a clean end."""

from __future__ import annotations

import ctypes
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import cv2
import rosgraph
import rospy
import rospy.core
import rospy.impl.paramserver
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from genpy import Message
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

from vsx_hw.errors import DeviceError
from vsx_ros.config import Config, from_dict
from vsx_ros.errors import ConfigError, InputError, VsxError, disk_trouble
from vsx_ros.registry import load_plugins
from vsx_ros.ros import calls, frames, topics
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs import streams

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

# Bigger than any image: with rospy's default of 64 kB a slow callback sees images of a second ago (ros_comm #536).
IMAGE_BUFFER_BYTES = 2**24

# Two seconds of the wheels: a second without them looks like a base that was restarted, though only this process slept.
ODOMETRY_QUEUE = 100

_OMITS_TOPICS = "/rosout_disable_topics_generation"
_NAME_AGAIN_S = 5.0
_TELL_AGAIN_S = 30.0
_AHEAD_S = 1.0
_LOOK_S = 0.05
"""rospy.spin would sleep for half a second."""
_LET_GO_S = 5.0

DIE_WITH_PARENT = "VSX_DIE_WITH_PARENT"
"""Environment variable: a node started by a run ends when the run is killed."""

logger = logging.getLogger(__name__)
_said_s: dict[str, float] = {}
_saying = threading.Lock()


class Node(Protocol):
    """What ``run`` needs: advertise and subscribe on construction, let go in ``close``."""

    def close(self) -> None:
        """Stop threads, write what must be written. Called once, when ROS shuts down."""


def run(name: str, build: Callable[[Config], Node]) -> None:
    """Be the node ``name`` until ROS shuts down.

    ``build`` constructs it from the configuration in the private parameter ``~config``; whatever it must compile
    it compiles before it advertises. A broken promise (configuration, calibration, device) is logged as one
    sentence and ends the process with exit code 1, 2 for a device.
    """
    _die_with_parent()
    quiet_failures()
    cv2.setNumThreads(1)
    if not rosgraph.is_master_online():
        sys.stderr.write(
            f"{name}: no ROS master answers at {rosgraph.get_master_uri()}; start one with 'roscore', set "
            "ROS_MASTER_URI, or let roslaunch or 'vsx explore' bring one\n"
        )
        sys.exit(1)
    let_go = _close_on_signals()
    try:
        rospy.init_node(name, disable_signals=True)
        master_watch()
        frames.adopt_prefix()
        bridge_logging()
        log_without_master()
        load_plugins()
        node = build(configuration())
    except (KeyboardInterrupt, rospy.ROSInterruptException):
        let_go()
        return
    except (VsxError, DeviceError) as error:
        rospy.logfatal("%s: %s", name, error)
        rospy.signal_shutdown(str(error))
        sys.exit(2 if isinstance(error, DeviceError) else 1)
    except ConnectionError:
        if rosgraph.is_master_online():
            raise
        rospy.logfatal("%s: the ROS master went away while this node started; start both again", name)
        rospy.signal_shutdown("no master")
        sys.exit(1)
    unclosed = threading.Lock()

    def close() -> None:
        """Once: what is added while ROS shuts down is never called by it."""
        if unclosed.acquire(blocking=False):
            node.close()

    rospy.on_shutdown(close)
    rospy.loginfo("%s: ready", rospy.get_name())
    while not rospy.is_shutdown():
        time.sleep(_LOOK_S)
    let_go()
    close()


def quiet_failures() -> None:
    """What a node says never ends it, and what it asks the master never holds it for ever."""
    streams.never_fail()
    os.environ.setdefault("ROS_PYTHON_LOG_CONFIG_FILE", str(Path(__file__).with_name("python_logging.conf")))
    calls.bound_master_calls()


def _close_on_signals() -> Callable[[], None]:
    """Shut down on SIGINT, SIGTERM and SIGHUP, on a thread; what waits until that is done, if a signal came.

    rospy does it in the handler, on top of whatever the main thread is at: if that is a question to the master, the
    handler waits for the question's lock for ever.
    """
    heard, told = os.pipe()
    os.set_blocking(told, False)
    signal.set_wakeup_fd(told)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: None)
    came = threading.Event()

    def close() -> None:
        number = os.read(heard, 1)[0]
        came.set()
        rospy.signal_shutdown(signal.Signals(number).name)

    thread = threading.Thread(target=close, name="signals", daemon=True)
    thread.start()
    return lambda: thread.join(_LET_GO_S) if came.is_set() else None


def configuration() -> Config:
    """The configuration: the tree ``config`` of the namespace, entries of the node's own ``~config`` first.

    Raises ConfigError naming the entry.
    """
    tree: dict[str, Any] = {}
    for name in ("config", "~config"):
        branch: Any = rospy.get_param(name, {})
        if not isinstance(branch, dict):
            raise ConfigError(f"parameter {rospy.resolve_name(name)} is {branch!r}, not a tree of names")
        tree = _merged(tree, branch)
    return from_dict(tree)


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    merged = {**below, **above}
    for name in below.keys() & above.keys():
        if isinstance(below[name], dict) and isinstance(above[name], dict):
            merged[name] = _merged(below[name], above[name])
    return merged


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


def is_ending() -> bool:
    """Whether the node is about to end: topics close, and refuse to publish, before ``rospy.is_shutdown`` is true."""
    return bool(rospy.core.is_shutdown_requested())


def now_ns() -> int:
    """ROS time, the clock of all stamps [ns]."""
    nanoseconds: int = rospy.Time.now().to_nsec()
    return nanoseconds


def refuse_future(stamp_ns: int) -> None:
    """Raises InputError for a reading of a second to come: beside it all others would be out of date until then."""
    ahead_s = (stamp_ns - now_ns()) * 1e-9
    if ahead_s > _AHEAD_S:
        raise InputError(
            f"a stamp {ahead_s:.1f} s ahead of this machine's clock is not believed; 'vsx doctor' compares the clocks"
        )


def stamp(stamp_ns: int) -> Any:
    """The rospy.Time of a stamp [ns]."""
    return rospy.Time(0, stamp_ns)


def subscribe(
    topic: str, kind: type[Message], callback: Callable[[Any], None], *, queue_size: int, **options: Any
) -> rospy.Subscriber:
    """Subscribe; a message that cannot be used is dropped and named, at most every few seconds."""
    named_s = -math.inf

    def guarded(msg: Any) -> None:
        nonlocal named_s
        try:
            callback(msg)
        except VsxError as error:
            if time.monotonic() - named_s > _NAME_AGAIN_S:
                named_s = time.monotonic()
                rospy.logerr("%s: %s", topic, error)
        except rospy.ROSException:
            if not is_ending():
                raise

    return rospy.Subscriber(topic, kind, guarded, queue_size=queue_size, **options)


def image_subscriber(callback: Callable[[Image], None]) -> rospy.Subscriber:
    """Subscribe to the camera so that the newest image, not a buffered one, arrives."""
    return subscribe(topics.IMAGE, Image, callback, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)


def odometry_subscriber(callback: Callable[[Odometry], None], topic: str = topics.ODOM) -> rospy.Subscriber:
    """Subscribe to the wheels so that every reading arrives, on a machine that was busy for a moment, too."""
    return subscribe(topic, Odometry, callback, queue_size=ODOMETRY_QUEUE, tcp_nodelay=True)


def worker(name: str, loop: Callable[[], None]) -> threading.Thread:
    """Run ``loop`` on a thread; if it raises, the whole node ends and says why.

    A node with a dead thread looks alive to everybody else, which is worse than a dead node.
    """

    def guarded() -> None:
        try:
            loop()
        except Exception as error:
            if isinstance(error, rospy.ROSException) and is_ending():
                return  # topics close while threads still run
            if isinstance(error, VsxError | DeviceError):
                rospy.logfatal("%s", error)
            else:
                logger.exception("thread %r failed", name)
            rospy.signal_shutdown(f"thread {name!r} failed: {error}")

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread


def every(period_s: float, name: str, step: Callable[[], None]) -> threading.Thread:
    """Call ``step`` on a thread of its own every ``period_s`` seconds until ROS shuts down.

    On the monotonic clock: ROS time may stand, and all that keeps the robot safe would stand with it.
    """

    def loop() -> None:
        due_s = time.monotonic()
        while not is_ending():
            step()
            due_s = max(due_s + period_s, time.monotonic())  # what was missed is not made up for
            time.sleep(max(0.0, due_s - time.monotonic()))

    return worker(name, loop)


def due(what: str, period_s: float) -> bool:
    """Whether ``what`` was not due for so long: to say something now and then, also while ROS time stands, which
    rospy's own throttle goes by."""
    now_s = time.monotonic()
    with _saying:
        is_due = now_s - _said_s.get(what, -math.inf) > period_s
        if is_due:
            _said_s[what] = now_s
    return is_due


def ended(thread: threading.Thread, within_s: float) -> bool:
    """Wait for one of the node's threads; the one that ends the node because it failed counts as ended."""
    if thread is threading.current_thread():
        return True
    thread.join(within_s)
    return not thread.is_alive()


def tried(last: Callable[[], None]) -> None:
    """Do one of the last things of a node; what goes wrong is told, and the next is done all the same."""
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
def told() -> Iterator[None]:
    """What goes wrong inside is told, now and then, and ends nothing: for work the robot can do without."""
    try:
        yield
    except VsxError as error:
        if due("told", _TELL_AGAIN_S):
            rospy.logerr("%s", error)


class Diagnostics:
    """Publishes the last known condition of the node's components once a second (REP 107), an error at once."""

    def __init__(self, hardware_id: str = "") -> None:
        self._hardware_id = hardware_id or rospy.get_name()
        self._components: dict[str, tuple[int, str, dict[str, str]]] = {}
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher(topics.DIAGNOSTICS, DiagnosticArray, queue_size=5)
        every(1.0, "diagnostics", self._publish)

    def set(self, component: str, level: int, message: str, **values: object) -> None:
        """Replace what is known of a component; ``values`` become key-value strings."""
        with self._lock:
            before = self._components.get(component)
            self._components[component] = (level, message, {k: str(v) for k, v in values.items()})
        if level == ERROR and before is not None and before[0] != ERROR:
            self._publish({component})

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


def _die_with_parent() -> None:
    """Ask the kernel for SIGINT when the run that started this node is gone, however it went."""
    if os.environ.get(DIE_WITH_PARENT) and sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None, use_errno=True).prctl(pr_set_pdeathsig, signal.SIGINT)
