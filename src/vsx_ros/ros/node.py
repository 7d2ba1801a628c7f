"""A node from start to end: configuration, signals, exit codes."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NoReturn, Protocol

import cv2
import rosgraph
import rospy

from vsx_hw.errors import DeviceError
from vsx_ros.config import Config, from_dict
from vsx_ros.errors import ConfigError, VsxError
from vsx_ros.registry import load_plugins
from vsx_ros.ros import calls, headers, logs, threads
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs import memory, process

_LOOK_S = 0.05  # rospy.spin would sleep for half a second
_LET_GO_S = 5.0  # for a thread to finish after the node
_STUCK_S = 10.0  # from what ends the node until rospy closes it
_LONGEST_S = 60.0  # until it has ended; on a busy machine vslam needs seconds to write results

DIE_WITH_PARENT = "VSX_DIE_WITH_PARENT"  # Environment variable: a node started by a run ends when the run is killed
PARAMETERS_SET = "live_run/parameters_set"  # Parameter: the run has set all nodes' parameters at this master
AUTO, NOWHERE = "auto", "none"  # of ~run_dir
_PARAMETERS_S = 10.0  # roslaunch sets them before the start, a new master later


class Node(Protocol):
    """What ``run`` needs: advertise and subscribe in the constructor, release everything in ``close``."""

    def close(self) -> None:
        """Stop threads and write results. Called once, when ROS shuts down."""


def run(name: str, build: Callable[[Config], Node]) -> None:
    """Run the node ``name`` until ROS shuts down. ``build`` makes it from the configuration in the parameter
    ``~config`` and compiles everything before it advertises. A VsxError is logged as one sentence and ends the process
    with exit code 1; a DeviceError does the same with exit code 2. So does a thread that fails later."""
    _die_with_parent()
    memory.return_freed_memory()
    logs.quiet_failures()
    cv2.setNumThreads(1)
    if not rosgraph.is_master_online():
        sys.stderr.write(
            f"{name}: no ROS master answers at {rosgraph.get_master_uri()}; start one with 'roscore', set "
            "ROS_MASTER_URI, or let roslaunch or 'vsx explore' bring one\n"
        )
        sys.exit(1)
    told = _EndingSignals()
    try:
        node = _start(name, build)
    except (KeyboardInterrupt, rospy.ROSInterruptException):
        told.let_go()
        return
    except (VsxError, DeviceError) as error:
        _fail(name, str(error), 2 if isinstance(error, DeviceError) else 1)
    except ConnectionError:
        if rosgraph.is_master_online():
            raise
        _fail(name, "the ROS master went away while this node started; start both again", 1)
    unclosed = threading.Lock()

    def close() -> None:
        """Close once. ROS skips hooks added during shutdown, so ``run`` calls this, too."""
        if unclosed.acquire(blocking=False):
            node.close()

    rospy.on_shutdown(close)
    rospy.loginfo("%s: ready", rospy.get_name())
    _wait_for_end(name, told, node, unclosed)
    told.let_go()
    calls.within(_LONGEST_S, close, name)
    if (code := threads.exit_code()) != 0:
        process.leave(code)


def _wait_for_end(name: str, told: _EndingSignals, node: Node, unclosed: threading.Lock) -> None:
    """Wait until ROS has shut down. If that hangs after a signal, a failed thread or its own begin, end the process
    without rospy and its locks: after _STUCK_S if ``close`` has not begun, after _LONGEST_S whatever hangs."""
    going_s = trimmed_s = time.monotonic()
    while not rospy.is_shutdown():
        time.sleep(_LOOK_S)
        now_s = time.monotonic()
        if not (told.came or threads.exit_code() or threads.is_ending()):
            going_s = now_s
        if now_s - going_s > _STUCK_S and unclosed.acquire(blocking=False):
            _end_alone(name, node.close)
        if now_s - going_s > _LONGEST_S:
            _end_alone(name, lambda: None)
        if now_s - trimmed_s > memory.TRIM_EVERY_S:
            memory.trim()
            trimmed_s = now_s


def _end_alone(name: str, close: Callable[[], None]) -> NoReturn:
    def end() -> None:
        sys.stderr.write(f"{name}: its shutdown hangs; it ends by itself\n")
        close()

    try:
        calls.within(_LONGEST_S - _STUCK_S, end, name)
    except BaseException as error:
        sys.stderr.write(f"{name}: its closing failed: {error!r}\n")
    finally:
        os._exit(threads.exit_code() or 1)


def _start(name: str, build: Callable[[Config], Node]) -> Node:
    rospy.init_node(name, disable_signals=True)
    master_watch()
    _await_parameters()
    master_watch().remember(headers.adopt_prefix())
    logs.bridge_logging()
    logs.log_without_master()
    load_plugins()
    return build(configuration())


def _await_parameters() -> None:
    """Wait for the parameters of all nodes. A restarted node of a live run may reach a new master before the run has
    set them there."""
    deadline_s = time.monotonic() + _PARAMETERS_S
    while os.environ.get(DIE_WITH_PARENT) and not rospy.has_param(PARAMETERS_SET) and time.monotonic() < deadline_s:
        time.sleep(0.05)


def _fail(name: str, reason: str, exit_code: int) -> NoReturn:
    rospy.logfatal("%s: %s", name, reason)
    rospy.signal_shutdown(reason)
    sys.exit(exit_code)


class _EndingSignals:
    """Shuts down on SIGINT, SIGTERM and SIGHUP, on a thread.

    rospy shuts down inside the signal handler, which interrupts the main thread. If that thread is calling the master,
    the handler waits for the lock of that call forever."""

    def __init__(self) -> None:
        self.came = False
        heard, told = os.pipe()
        os.set_blocking(told, False)
        signal.set_wakeup_fd(told)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            # Shells and nohup let what they start ignore the other two; a node must always be told to end by SIGTERM.
            if number == signal.SIGTERM or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._on_signal)
        self._thread = threading.Thread(target=self._shut_down, args=(heard,), name="signals", daemon=True)
        self._thread.start()

    def _on_signal(self, *_: object) -> None:
        self.came = True

    def _shut_down(self, heard: int) -> None:
        number = os.read(heard, 1)[0]
        self.came = True
        rospy.signal_shutdown(signal.Signals(number).name)

    def let_go(self) -> None:
        """Wait for the end if a signal came."""
        if self.came:
            self._thread.join(_LET_GO_S)


def configuration() -> Config:
    """The configuration: the tree ``config`` of the namespace; the node's own ``~config`` takes precedence. Raises
    ConfigError naming the entry."""
    tree: dict[str, Any] = {}
    for name in ("config", "~config"):
        branch: Any = rospy.get_param(name, {})
        if not isinstance(branch, dict):
            raise ConfigError(f"parameter {rospy.resolve_name(name)} is {branch!r}, not a tree of names")
        tree = _merged(tree, branch)
    return from_dict(tree)


def run_dir() -> str:
    """The folder of the run, from ~run_dir; if that is auto, the one that the launch file has made for all nodes.
    none, or empty: nothing is kept."""
    told = str(rospy.get_param("~run_dir", ""))
    told = str(rospy.get_param("run_dir", "")) if told == AUTO else told
    return "" if told == NOWHERE else told


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    merged = {**below, **above}
    for name in below.keys() & above.keys():
        if isinstance(below[name], dict) and isinstance(above[name], dict):
            merged[name] = _merged(below[name], above[name])
    return merged


def _die_with_parent() -> None:
    """Ask the kernel to send SIGINT when the parent run has ended for any reason."""
    if os.environ.get(DIE_WITH_PARENT) and sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None, use_errno=True).prctl(pr_set_pdeathsig, signal.SIGINT)
