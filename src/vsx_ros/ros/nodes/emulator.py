"""Node ``emulator``: a building with a TurtleBot in it, under the real drivers.

Subscribers: none. The devices are a serial port and a camera socket; no node of the stack may listen to the truth.
Publishers: emulator/ground_truth/odometry (frame world: that of the world file, 30 Hz),
    emulator/ground_truth/camera_pose (per image, with its stamp), emulator/ground_truth/collisions and
    .../least_clearance_m (smallest distance of the hull so far; both latched), emulator/render_rate_hz (1 Hz).
Parameters: ~world (lab): a generator, a Gazebo file, a world.yaml or a map. ~seed (0). ~robot_type (kobuki).
    ~port (ttyVSX in the folder for temporary files): the serial port it makes. ~camera_socket (vsx_kinect, there):
    the socket it makes; the camera's calibration is written beside it, with .yaml appended. ~rate_hz (15.0): maximum
    images per second. ~dock (X,Y,DEG: a dock stands there in the world and looks to DEG; none). ~battery_pace (1.0):
    how many times faster than a real one the battery drains and charges. ~hard (names of docs/how-to/hard-things.md,
    NAME=AMOUNT with commas between: what makes the world hard; none). ~config (tree of
    'vsx config'). The board runs at 200 Hz; a child process renders."""

import tempfile
import time
from typing import Any

import rospy
from std_msgs.msg import Float32

from vsx_hw.bases import base_emulator
from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.ros import logs, node, threads, topics
from vsx_ros.ros.base_drivers import wired
from vsx_ros.ros.emulated_base import BodyPlant, dock_pose
from vsx_ros.ros.emulated_truth import TruthTopics
from vsx_ros.ros.emulation import RenderChild, RenderSettings
from vsx_ros.ros.logs import OK, WARN, Diagnostics
from vsx_ros.runs.world import open_world

_TRUTH_PERIOD_S = 1.0 / 30.0  # as often as images


class EmulatorNode:
    """Begins with the child, which takes seconds for its world and first picture, then the emulated base."""

    def __init__(self, config: Config, child: RenderChild) -> None:
        world_name, seed = str(rospy.get_param("~world", "lab")), int(rospy.get_param("~seed", 0))
        robot_type = str(rospy.get_param("~robot_type", "kobuki"))
        rate_hz = float(rospy.get_param("~rate_hz", 15.0))
        if not 1.0 <= rate_hz <= 60.0:
            raise ConfigError(f"~rate_hz is {rate_hz:g}; give 1 to 60 images a second")
        battery_pace = float(rospy.get_param("~battery_pace", 1.0))
        if not 0.0 <= battery_pace <= 1000.0:
            raise ConfigError(f"~battery_pace is {battery_pace:g}; give 0 to 1000 times a real battery's")
        hard = str(rospy.get_param("~hard", ""))
        world = open_world(world_name, seed, hard=[hard], where="~hard")
        self._rate_pub = rospy.Publisher(topics.RENDER_RATE, Float32, queue_size=1)
        self._frames, self._skipped, self._render_ms, self._diagnostics = 0, 0, 0.0, Diagnostics("emulator")
        start_ns, start_monotonic_ns = time.time_ns(), time.monotonic_ns()
        self._truth = TruthTopics(start_ns)
        socket = str(rospy.get_param("~camera_socket", f"{tempfile.gettempdir()}/vsx_kinect"))
        port = str(rospy.get_param("~port", f"{tempfile.gettempdir()}/ttyVSX"))
        settings = RenderSettings(
            world=world_name, seed=seed, hard=hard, socket=socket, rate_hz=rate_hz, start_ns=start_ns,
            robot=config.robot,
        )  # fmt: skip
        self._child = child
        child.begin(settings)
        threads.worker("frames", lambda: self._child.listen(self._on_frame))
        wheel_base_m, dock = wired(robot_type).wheel_base_m, dock_pose(str(rospy.get_param("~dock", "")))
        self._plant = BodyPlant(world, seed, config.robot, self._child.move, wheel_base_m, dock)
        self._base = base_emulator(robot_type, self._plant, port, seed, battery_pace)
        self._base.start(start_monotonic_ns)
        threads.every(_TRUTH_PERIOD_S, "truth", lambda: self._truth.body(self._plant))
        threads.every(1.0, "rate", self._report)

    def _on_frame(self, frame: dict[str, Any]) -> None:
        self._frames += 1
        self._skipped += frame["skipped"]
        self._render_ms = frame["render_ms"]
        self._truth.camera(frame)

    def _report(self) -> None:
        rate_hz, skipped = self._frames, self._skipped
        self._frames = self._skipped = 0
        self._rate_pub.publish(Float32(rate_hz))
        level = OK if rate_hz else WARN
        message = f"{rate_hz} images a second" if rate_hz else "no images; nobody listens, or the first one compiles"
        self._diagnostics.set("camera", level, message, render_ms=round(self._render_ms, 1), skipped=skipped)
        if logs.due("rate", 30.0):
            rospy.loginfo("emulator: %s, %.0f ms each, %d slots skipped", message, self._render_ms, skipped)

    def close(self) -> None:
        """Remove the devices and end the child."""
        self._base.close()
        self._child.close()


def main() -> None:
    """Entry point of scripts/emulator."""
    child = RenderChild()  # before there are threads
    node.run("emulator", lambda config: EmulatorNode(config, child))
