"""The processes of a live run: a master if none runs, all nodes, a monitor for them, and a stop at the end."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import rosgraph
import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool

from vsx_ros.config import Config, to_dict
from vsx_ros.errors import ConfigError
from vsx_ros.ros import calls, launch, logs, node, topics
from vsx_ros.ros.environment import DEFAULT_MASTER, package_environment
from vsx_ros.ros.fork_server import ForkServer
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.left_behind import end_standing_time, living
from vsx_ros.ros.master_guard import MasterGuard
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.ros.nodes.dashboard import prepare_view
from vsx_ros.runs import process
from vsx_ros.runs.process import SignalFlag

READY_WAIT_S = 180.0  # for the nodes: they may have to compile kernels
_STOP_S = 0.6  # zero commands are sent for this long
_ESTOP_WAIT_S = 2.0  # for the base's answer
_LEAVE_S = 1.0  # to unregister from a master that may be gone
_END_S = launch.SIGINT_TIMEOUT_S + launch.SIGTERM_TIMEOUT_S + 1.0
"""Nodes first, then the master. By then roslaunch has killed them, unless it hangs itself."""
_ESTOPPED = "mobile_base/estopped"
MASTER = "master"  # roslaunch's name for the master process that it started


class LiveRun:
    """A context manager: whatever happens inside, it stops the robot and ends every process."""

    def __init__(
        self,
        nodes: list[LaunchNode],
        config: Config,
        vital: tuple[str, ...],
        log: Path,
        *,
        view: bool,
        replayed: bool,
        forks: ForkServer | None = None,
    ) -> None:
        """vital: names of nodes without which the run cannot continue. log: folder for their output. view: with the
        live view at ``url``. replayed: a recording gives the time, and there is no robot to stop. forks: starts the
        nodes. Raises ConfigError when the view cannot be shown."""
        os.environ["ROS_LOG_DIR"] = str(log.resolve())
        log.mkdir(exist_ok=True)
        self.url, self.port = "", 0
        if view:
            self.port, self.url = prepare_view()
            nodes = nodes + launch.view(port=self.port)
        self._names = [node.name for node in nodes]
        self._text = launch.xml(nodes, to_dict(config), {"/use_sim_time": True} if replayed else None)
        self._vital, self._replayed = vital, replayed
        self._parent: Any = None
        self._forks = forks
        self._guard: MasterGuard | None = None
        self._zero_pub: Any = None
        self._dead: list[str] = []
        self._to_release = ""
        self._heard: SignalFlag | None = None
        self._redirected = contextlib.ExitStack()
        self._terminal = process.lossy(os.dup(2), close=True)
        self.progress = process.Progress(self._terminal)

    @property
    def interrupted(self) -> bool:
        """Whether someone pressed Ctrl-C or sent SIGTERM."""
        return self._heard is not None and self._heard.came

    @property
    def dead(self) -> str:
        """The first vital node that died, or the master if this run started it; else an empty string."""
        return next((name for name in self._dead if name in (*self._vital, MASTER)), "")

    def __enter__(self) -> LiveRun:
        """Start everything. Raises ConfigError if there is no master, a robot already runs, or roslaunch fails."""
        os.environ[node.DIE_WITH_PARENT] = "1"
        package_environment()
        choose_master()
        refuse_second_robot(self._names)
        if not self._replayed and (said := end_standing_time()):
            self.progress.say(said)
        self._silence()
        try:
            self._start()
            ends = "ends the replay" if self._replayed else "stops the robot"
            self.progress.say(f"nodes are starting at ROS_MASTER_URI={os.environ['ROS_MASTER_URI']}; Ctrl-C {ends}")
            if self.url:
                self.progress.say(f"live view: {self.url}")
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the robot, then the processes."""
        try:
            if self._replayed:
                _tried(calls.MASTER_S, lambda: rospy.delete_param("/use_sim_time"), "the ROS master")
            else:
                self.stop_robot()
        finally:
            self._end()

    def _start(self) -> None:
        self._heard = SignalFlag(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        try:
            self._parent = launch.start(self._text, self._forks, quiet=True)
        except Exception:
            if self.interrupted:  # roslaunch complains about processes that the signal ended
                raise KeyboardInterrupt from None
            raise
        self._heard.listen()  # roslaunch has replaced the signal handlers
        self._guard = MasterGuard(each.popen.pid for each in self._parent.pm.procs if self._is_of_ros(each))
        self._parent.runner.pm.add_process_listener(SimpleNamespace(process_died=self._remember_dead))
        rospy.init_node("run", disable_signals=True, anonymous=True)
        logs.log_without_master()
        master_watch().remember({param.key: param.value for param in self._parent.config.params.values()})
        master_watch().keep({node.PARAMETERS_SET: True})  # written after all other parameters
        self._zero_pub = rospy.Publisher(topics.COMMAND_SAFETY, Twist, queue_size=1)

    def _is_of_ros(self, process: Any) -> bool:
        """Whether it is the master or rosout; the nodes end by themselves when this process is killed."""
        return process.popen is not None and process.name.rsplit("-", 1)[0] not in self._names

    def _remember_dead(self, process_name: str, _: int) -> None:
        self._dead.append(process_name.rsplit("-", 1)[0])  # roslaunch adds a number to process names

    def _end(self) -> None:
        _tried(_LEAVE_S, lambda: rospy.signal_shutdown("the run is over"), "the ROS master")
        if self._parent is not None:
            started = list(self._parent.pm.procs) if self._parent.pm is not None else []
            _tried(_END_S, self._parent.shutdown, "roslaunch")
            _kill(started)
        self._release()
        if self._guard is not None:
            self._guard.close()
        self._redirected.close()

    def _silence(self) -> None:
        """Redirect all output of roslaunch and the nodes to a file; only ``progress`` uses the terminal."""
        file = Path(os.environ["ROS_LOG_DIR"]) / "terminal.log"
        log = process.lossy(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), close=True)
        self._redirected.enter_context(log)
        self._redirected.callback(os.dup2, self._terminal.fileno(), 2)
        os.dup2(log.fileno(), 2)
        self._redirected.enter_context(contextlib.redirect_stdout(log))

    def stop_robot(self) -> None:
        """Send zero at the highest priority, and the emergency stop; either one alone is enough."""
        deadline_s = time.monotonic() + _STOP_S
        ask = partial(_tried, calls.MASTER_S, self._remember_who_stopped, "the ROS master")
        asking = threading.Thread(target=ask, daemon=True)
        asking.start()
        while time.monotonic() < deadline_s or asking.is_alive():
            self._zero_pub.publish(Twist())
            time.sleep(0.05)
        try:
            calls.service(topics.ESTOP, SetBool, True, within_s=_ESTOP_WAIT_S)
        except (rospy.ROSException, rospy.ServiceException) as error:
            rospy.logwarn("no emergency stop: %s", error)

    def _remember_who_stopped(self) -> None:
        if not rospy.get_param(_ESTOPPED, False):
            self._to_release = rospy.resolve_name(_ESTOPPED)

    def _release(self) -> None:
        """Remove the emergency stop after all processes have ended. A master that keeps running must not stop the next
        run, unless the operator had pressed the stop."""
        if self._to_release:
            _tried(calls.MASTER_S, lambda: rosgraph.Master("/vsx").deleteParam(self._to_release), "the ROS master")


def _tried(seconds: float, last: Callable[[], object], whom: str) -> None:
    """Do one of a run's last steps; a failure is only logged."""
    try:
        calls.within(seconds, last, whom)
    except Exception as error:
        rospy.logwarn("%s: %s", whom, error)


def _kill(started: Sequence[Any]) -> None:
    """Kill what roslaunch has left alive; each process leads its own group."""
    for each in started:
        child = each.popen
        if child is not None and child.poll() is None:
            with contextlib.suppress(OSError):
                os.killpg(child.pid, signal.SIGKILL)


def choose_master() -> None:
    """Use the running master. Else let roslaunch start one, at the usual port or at a free one if that is taken. Raises
    ConfigError when ROS_MASTER_URI names another machine without a master, or a name without an address."""
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if rosgraph.is_master_online(uri):
        return
    host, port = rosgraph.network.parse_http_host_and_port(uri)
    try:
        socket.getaddrinfo(host, port)
    except OSError:
        raise ConfigError(
            f"the name {host!r} in ROS_MASTER_URI={uri} has no address; if it is this machine, add the line "
            f"'127.0.0.1 {host}' to /etc/hosts"
        ) from None
    if not rosgraph.network.is_local_address(host):
        raise ConfigError(f"no ROS master answers at ROS_MASTER_URI={uri}; start it there, or unset ROS_MASTER_URI")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            probe.bind(("", 0))
            os.environ["ROS_MASTER_URI"] = f"http://localhost:{probe.getsockname()[1]}"


def refuse_second_robot(names: Sequence[str]) -> None:
    """Raises ConfigError if one of these nodes already runs in this namespace: ROS would end it in favour of the new
    one, even while it drives. A node that died without unregistering does not count."""
    namespace = rosgraph.names.get_ros_namespace()
    found = list[str]()
    with contextlib.suppress(OSError):
        found = living(rosgraph.names.ns_join(namespace, name) for name in names)
    if found:
        raise ConfigError(
            f"node {found[0]} runs already at {rosgraph.get_master_uri()}, and a second one would end it; end that "
            "run first, or give this one a name of its own (ROS_NAMESPACE=robot2) or a master "
            "of its own (ROS_MASTER_URI=http://localhost:11312)"
        )
