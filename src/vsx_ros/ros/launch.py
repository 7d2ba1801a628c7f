"""The nodes of a robot and their parameters: one table for Python, tests and documentation.

launch/*.launch hold the same for users of roslaunch; a test compares the two."""

import contextlib
import shlex
import shutil
from typing import Any, NamedTuple
from xml.sax.saxutils import escape, quoteattr

import roslaunch.core
import roslaunch.parent
import roslaunch.rlutil
import rospkg
import yaml
from roslaunch.nodeprocess import LocalProcess, create_node_process
from roslaunch.pmon import Process

from vsx_ros.errors import ConfigError
from vsx_ros.ros import topics
from vsx_ros.ros.environment import THREADS, package_environment
from vsx_ros.ros.fork_server import Copy, ForkServer, Request
from vsx_ros.ros.node import AUTO

# Time to the next stronger signal; roslaunch: 15 and 2 s. On a busy machine vslam needs seconds to write results.
SIGINT_TIMEOUT_S, SIGTERM_TIMEOUT_S = 6.0, 1.0


class LaunchNode(NamedTuple):
    """One process. respawn: restart it when it dies; the wheels stand still until it is back. required: when it ends,
    all nodes end. clear_params: forget what clients of an earlier launch changed, on a master that lasts; a restart
    within the launch keeps what they change."""

    name: str
    params: dict[str, Any]
    respawn: bool = False
    package: str = "vsx_ros"
    type: str = ""
    args: str = ""
    required: bool = False
    clear_params: bool = False


class BagTopics(NamedTuple):
    """The bag's names for the camera and odometry topics."""

    image: str = "/camera/rgb/image_raw"
    camera_info: str = "/camera/rgb/camera_info"
    odometry: str = "/odom"

    @property
    def shutter(self) -> str:
        """What the camera told of its shutter, beside the images."""
        return f"{self.image.rpartition('/')[0]}/shutter"

    @property
    def factors(self) -> str:
        """What the base told of the factors in its odometry, beside that."""
        return f"{self.odometry.rpartition('/')[0]}/{topics.ODOM_FACTORS}"


def bringup(base: str = "auto", port: str = "/dev/kobuki", camera: str = "kinect", info: str = "") -> list[LaunchNode]:
    """The robot itself: base and camera. base: its kind, or auto; info: URL or path of the camera's calibration. With
    the camera ``ros`` the images already come on our topics, so no camera node is started."""
    nodes = [LaunchNode("mobile_base", {"robot_type": base, "port": port}, respawn=True)]
    if camera != "ros":
        nodes.append(LaunchNode("camera", {"device": camera, "camera_info_url": info}, respawn=True))
    return nodes


def emulation(
    world: str,
    seed: int = 0,
    devices: str = "/tmp",
    base: str = "kobuki",
    rate_hz: float = 15.0,
    dock: str = "",
    battery_pace: float = 1.0,
    hard: str = "",
) -> list[LaunchNode]:
    """An emulated robot under the real drivers. devices: folder for port and socket. base: its kind; auto emulates a
    Kobuki and leaves its driver on auto. rate_hz: images per second. dock: X,Y,DEG of a dock in the world.
    battery_pace: how many times faster than a real one the battery drains and charges. hard: NAME=AMOUNT of what makes
    the world hard, with commas between, beside what its file says."""
    port, camera_socket = f"{devices}/vsx_base", f"{devices}/vsx_camera"
    kind = "kobuki" if base == "auto" else base
    emulator = {"world": world, "seed": seed, "robot_type": kind, "port": port, "camera_socket": camera_socket}
    emulator["rate_hz"] = rate_hz
    return [
        LaunchNode("emulator", {**emulator, "dock": dock, "battery_pace": battery_pace, "hard": hard}),
        *bringup(base, port, f"emulator:{camera_socket}"),
    ]


def vslam(seed: int, run_dir: str, **chosen: Any) -> LaunchNode:
    """The SLAM with all its parameters but ~save_map_to: a master that lasts still has those of an earlier launch."""
    usual = {"use_odometry": True, "load_map": "", "save_map": "", "room": "", "zones": ""}
    return LaunchNode("vslam", {"seed": seed, "run_dir": run_dir, **usual, **chosen})


def exploration(
    planner: str = "fov", seed: int = 0, run_dir: str = AUTO, load_map: str = "", room: str = "", zones: str = ""
) -> list[LaunchNode]:
    """All nodes above the robot. run_dir: for results; auto: the parameter of that name in the namespace. load_map: a
    SLAM map to continue. room: the only one of it to explore. zones: a file of zones to begin with."""
    return [
        vslam(seed, run_dir, load_map=load_map, room=room, zones=zones),
        LaunchNode("move_base", {"planner": planner, "seed": seed}, respawn=True, clear_params=True),
        LaunchNode("follower", {}, respawn=True),
        LaunchNode("explore", {"run_dir": run_dir}),
        LaunchNode("dock", {"seed": seed}, respawn=True),
    ]


def keeping(run_dir: str = AUTO, camera: str = "", *, emulated: bool = False) -> list[LaunchNode]:
    """What completes the run's folder, for launches without ``vsx explore``, which does that itself. camera: as of
    ``bringup``; without one, that of the node camera. emulated: the robot is the emulator's."""
    return [LaunchNode("run_folder", {"run_dir": run_dir, "emulated": emulated, "camera": camera})]


def view(host: str = "127.0.0.1", port: int = 8765) -> list[LaunchNode]:
    """The live view in a browser."""
    return [LaunchNode("dashboard", {"host": host, "port": port}, respawn=True)]


def replay(
    bag: str, rate: float = 1.0, use_odometry: bool = True, run_dir: str = AUTO, named: BagTopics | None = None
) -> list[LaunchNode]:
    """A recording instead of the robot, played by rosbag's own player; only the SLAM listens. It ends with the bag.
    run_dir: as of ``exploration``. The images keep their name, which tells rectified ones."""
    named = named or BagTopics()
    ours = {named.camera_info: topics.CAMERA_INFO, named.odometry: topics.ODOM}
    ours |= {named.shutter: topics.SHUTTER, named.factors: topics.ODOM_FACTORS}
    played, renamed = " ".join([named.image, *ours]), " ".join(f"{name}:={our}" for name, our in ours.items())
    play = f"--clock --wait-for-subscribers -r {rate:g} {shlex.quote(bag)} --topics {played} {renamed}"
    player = LaunchNode("player", {}, package="rosbag", type="play", args=play, required=True)
    slam = vslam(0, run_dir, use_odometry=use_odometry)._replace(args=f"{topics.IMAGE}:={named.image}")
    return [slam, player]


def xml(nodes: list[LaunchNode], config: dict[str, Any], params: dict[str, Any] | None = None) -> str:
    """The launch file of these nodes. config: tree of 'vsx config', for all nodes; nothing of an earlier launch stays
    beside it. params: of the namespace, or global with a leading slash."""
    lines = ["<launch>"]
    lines += [f'  <env name="{name}" value="{value}"/>' for name, value in THREADS.items()]
    text = escape(yaml.safe_dump(config, default_flow_style=True, width=10**6))
    lines.append(f'  <group ns="config" clear_params="true"><rosparam>{text}</rosparam></group>')
    lines += [_param(name, value, "  ") for name, value in (params or {}).items()]
    for node in nodes:
        lines.append(
            f'  <node pkg="{node.package}" type="{node.type or node.name}" name="{node.name}" output="screen"'
            f' respawn="{str(node.respawn).lower()}" required="{str(node.required).lower()}"'
            f' clear_params="{str(node.clear_params).lower()}"'
            f" args={quoteattr(node.args)}>"
        )
        lines += [_param(name, value, "    ") for name, value in node.params.items()]
        lines.append("  </node>")
    return "\n".join([*lines, "</launch>\n"])


def _param(name: str, value: Any, indent: str) -> str:
    text = str(value).lower() if isinstance(value, bool) else str(value)
    kinds: dict[type, str] = {bool: "bool", int: "int", float: "double", str: "str"}
    return f'{indent}<param name="{name}" type="{kinds[type(value)]}" value={quoteattr(text)}/>'


class _NodeCopy(LocalProcess):  # type: ignore[misc]  # roslaunch is untyped
    """A node that the fork server starts, also again; when it cannot, roslaunch does."""

    forks: ForkServer

    def start(self) -> bool:
        """Start the process; a stream that is not logged is ours."""
        with self.lock, contextlib.ExitStack() as files:
            self.popen: Copy | None = None
            with contextlib.suppress(OSError, roslaunch.core.RLException):  # logs that cannot be written
                logs = [files.enter_context(file) if file else None for file in self._configure_logging()]
                streams = [log.fileno() if log else number for log, number in zip(logs, (1, 2))]
                self.popen = self.forks.start(Request(self.args, self.env, rospkg.get_ros_home()), streams)
        if self.popen is None:
            return bool(super().start())
        Process.start(self)
        self.started, self.stopped, self.pid = True, False, self.popen.pid
        return True


class _Parent(roslaunch.parent.ROSLaunchParent):  # type: ignore[misc]  # roslaunch is untyped
    """roslaunch, with nodes of this package from a fork server."""

    forks: ForkServer | None = None

    def _init_runner(self) -> None:
        super()._init_runner()
        if self.forks is not None:
            self._anew, self.runner.launch_node = self.runner.launch_node, self._launched

    def _launched(self, node: roslaunch.core.Node, core: bool = False) -> tuple[object, bool]:
        if core or node.package != "vsx_ros":
            launched: tuple[object, bool] = self._anew(node, core)
            return launched
        uri, patience_s = self.config.master.uri, (self.sigint_timeout, self.sigterm_timeout)
        process = create_node_process(self.run_id, node, uri, *patience_s)
        process.__class__, process.forks = _NodeCopy, self.forks
        self.pm.register(process)
        node.process_name = process.name
        return process, process.start()


def start(
    text: str, forks: ForkServer | None = None, *, quiet: bool = False, sigint_s: float = SIGINT_TIMEOUT_S
) -> roslaunch.parent.ROSLaunchParent:
    """Start the nodes of a launch text, and a master if none runs. forks: starts the nodes of this package. Call it on
    the main thread. Raises ConfigError if roslaunch rejects the text."""
    package_environment()
    if shutil.which("rosmaster") is None:
        raise ConfigError("there is no rosmaster: install ROS with 'scripts/demo' or the packages of apt.txt")
    try:
        parent = _Parent(
            roslaunch.rlutil.get_or_generate_uuid(None, False),  # a running master already has one and accepts no other
            [],
            roslaunch_strs=[text],
            is_core=False,
            show_summary=not quiet,
            force_log=quiet,
            sigint_timeout=sigint_s,
            sigterm_timeout=SIGTERM_TIMEOUT_S,
        )
        parent.forks = forks
        parent.start(auto_terminate=False)
    except roslaunch.core.RLException as error:
        raise ConfigError(f"roslaunch: {error}") from error
    return parent
