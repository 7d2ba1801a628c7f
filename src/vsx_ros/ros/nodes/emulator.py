"""Node ``emulator``: a building with a TurtleBot in it, under the real drivers.

Subscribers: none. The devices are a serial port and a camera socket; nobody in the stack may listen to the truth.
Publishers: emulator/ground_truth/odometry (frame world: that of the world file, 30 Hz),
    emulator/ground_truth/camera_pose (per image, its stamp), emulator/ground_truth/collisions and
    .../least_clearance_m (of the hull to anything so far; both latched), emulator/render_rate_hz (1 Hz).
Parameters: ~world (lab): lab, office, corridor, building, a world.yaml or a map. ~seed (0). ~robot_type (kobuki).
    ~port (ttyVSX in the folder for temporary files): the serial port it makes.
    ~camera_socket (vsx_kinect, same folder): the socket it makes; the camera's calibration is written beside it, with
    .yaml appended. ~rate_hz (15.0): images a second at most. ~config (tree of 'vsx config').

The body and the board run on a thread of this process at 200 Hz; the camera renders in a child process.
"""

import os
import tempfile
import time
from typing import Any

import rospy
from std_msgs.msg import Float32

from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.ros import logs, node, threads, topics
from vsx_ros.ros.base_drivers import base_emulator, wheel_base_m
from vsx_ros.ros.diagnostics import OK, WARN, Diagnostics
from vsx_ros.ros.emulation import BodyPlant
from vsx_ros.ros.render_process import RenderChild, RenderSettings
from vsx_ros.ros.truth_topics import TruthTopics
from vsx_ros.runs.world import open_world

_TRUTH_PERIOD_S = 1.0 / 30.0


class EmulatorNode:
    """Starts the child before the clock: its world takes a second to compile, its first picture longer."""

    def __init__(self, config: Config) -> None:
        world_name, seed = str(rospy.get_param("~world", "lab")), int(rospy.get_param("~seed", 0))
        robot_type = str(rospy.get_param("~robot_type", "kobuki"))
        rate_hz = float(rospy.get_param("~rate_hz", 15.0))
        if not 1.0 <= rate_hz <= 60.0:
            raise ConfigError(f"~rate_hz is {rate_hz:g}; give 1 to 60 images a second")
        world = open_world(world_name, seed)
        self._rate_pub = rospy.Publisher(topics.RENDER_RATE, Float32, queue_size=1)
        self._frames = self._skipped = 0
        self._render_ms = 0.0
        self._diagnostics = Diagnostics("emulator")
        start_ns, start_monotonic_ns = time.time_ns(), time.monotonic_ns()
        self._truth = TruthTopics(start_ns)
        settings = RenderSettings(
            world=world_name,
            seed=seed,
            socket=_file_param("~camera_socket", "vsx_kinect"),
            rate_hz=rate_hz,
            start_ns=start_ns,
            robot=config.robot,
        )
        self._child = RenderChild(settings)
        threads.worker("frames", lambda: self._child.listen(self._on_frame))
        self._plant = BodyPlant(world, seed, config.robot, self._child.move, wheel_base_m(robot_type))
        self._base = base_emulator(robot_type, self._plant, _file_param("~port", "ttyVSX"), seed)
        self._base.start(start_monotonic_ns)
        threads.every(_TRUTH_PERIOD_S, "truth", lambda: self._truth.body(self._plant))
        threads.every(1.0, "rate", self._report)

    def _on_frame(self, frame: dict[str, Any]) -> None:
        self._frames += 1
        self._skipped += frame["skipped"]
        self._render_ms = frame["render_ms"]
        self._truth.camera(frame)

    def _report(self) -> None:
        rate_hz, self._frames = self._frames, 0
        skipped, self._skipped = self._skipped, 0
        self._rate_pub.publish(Float32(rate_hz))
        level = OK if rate_hz else WARN
        message = f"{rate_hz} images a second" if rate_hz else "no images; nobody listens, or the first one compiles"
        self._diagnostics.set("camera", level, message, render_ms=round(self._render_ms, 1), skipped=skipped)
        if logs.due("rate", 30.0):
            rospy.loginfo("emulator: %s, %.0f ms each, %d slots skipped", message, self._render_ms, skipped)

    def close(self) -> None:
        """Take the devices away and end the child."""
        self._base.close()
        self._child.close()


def _file_param(name: str, default: str) -> str:
    """A path; the default lies in the folder for temporary files."""
    return str(rospy.get_param(name, os.path.join(tempfile.gettempdir(), default)))


def main() -> None:
    """Entry point of scripts/emulator."""
    node.run("emulator", EmulatorNode)
