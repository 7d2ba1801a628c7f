"""Node ``emulator``: a building with a TurtleBot in it, under the real drivers.

Subscribers: none. The devices are a serial port and a camera socket; nobody in the stack may listen to the truth.
Publishers: emulator/ground_truth/odometry (frame world: that of the world file, 30 Hz),
    emulator/ground_truth/camera_pose (per image, its stamp), emulator/ground_truth/collisions and
    .../least_clearance_m (of the hull to anything so far; both latched), emulator/render_rate_hz (1 Hz).
Parameters: ~world (lab): lab, office, corridor, building, a world.yaml or a map. ~seed (0). ~robot_type (kobuki).
    ~port (ttyVSX in the folder for temporary files): the serial port it makes.
    ~camera_socket (vsx_kinect, same folder): the socket it makes; the camera's calibration is written beside it, with
    .yaml appended. ~rate_hz (15.0): images a second at most. ~config (tree of config.py).

The body and the board run on a thread of this process at 200 Hz; the camera renders in a child process.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any

import msgspec
import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMsg
from std_msgs.msg import Float32, UInt32

from vsx_ros.cli.world import open_world
from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, logs, node, threads, topics
from vsx_ros.ros.base_drivers import base_emulator, wheel_base_m
from vsx_ros.ros.diagnostics import OK, WARN, Diagnostics
from vsx_ros.ros.emulation import BodyPlant, BodyState
from vsx_ros.ros.render_process import POSE, RenderSettings

_WORLD_FRAME = "world"
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
        self._truth_pub = rospy.Publisher(topics.TRUTH_ODOMETRY, OdometryMsg, queue_size=10)
        self._camera_pub = rospy.Publisher(topics.TRUTH_CAMERA, PoseStamped, queue_size=10)
        self._collisions_pub = rospy.Publisher(topics.TRUTH_COLLISIONS, UInt32, queue_size=5, latch=True)
        self._clearance_pub = rospy.Publisher(topics.TRUTH_CLEARANCE, Float32, queue_size=5, latch=True)
        self._rate_pub = rospy.Publisher(topics.RENDER_RATE, Float32, queue_size=1)
        self._collisions, self._clearance_m = -1, float("inf")
        self._closing = False
        self._frames = self._skipped = 0
        self._render_ms = 0.0
        self._diagnostics = Diagnostics("emulator")
        self._start_ns, start_monotonic_ns = time.time_ns(), time.monotonic_ns()
        self._before: tuple[int, Any] | None = None
        self._child = self._start_child(
            RenderSettings(
                world=world_name,
                seed=seed,
                socket=_file_param("~camera_socket", "vsx_kinect"),
                rate_hz=rate_hz,
                start_ns=self._start_ns,
                robot=config.robot,
            )
        )
        self._plant = BodyPlant(world, seed, config.robot, self._on_step, wheel_base_m(robot_type))
        self._base = base_emulator(robot_type, self._plant, _file_param("~port", "ttyVSX"), seed)
        self._base.start(start_monotonic_ns)
        threading.Thread(target=self._listen, name="frames", daemon=True).start()
        threads.every(_TRUTH_PERIOD_S, "truth", self._publish_truth)
        threads.every(1.0, "rate", self._report)

    @staticmethod
    def _start_child(settings: RenderSettings) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        return subprocess.Popen(
            [sys.executable, "-m", "vsx_ros.ros.render_process", msgspec.json.encode(settings).decode()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            bufsize=0,
        )

    def _on_step(self, state: BodyState) -> None:
        """On the physics thread: tell the camera where the base is."""
        pose, stdin = state.T_world_base, self._child.stdin
        with contextlib.suppress(OSError):
            if stdin is not None:
                stdin.write(POSE.pack(state.time_ns, pose.x, pose.y, pose.theta, state.path_length_m))

    def _listen(self) -> None:
        """One line per image from the child; when it ends without being asked, so does the node."""
        assert self._child.stdout is not None
        for line in iter(self._child.stdout.readline, b""):
            frame = json.loads(line)
            self._frames += 1
            self._skipped += frame["skipped"]
            self._render_ms = frame["render_ms"]
            T_world_cam = SE3.from_quaternion(np.array(frame["translation"]), tuple(frame["quaternion"]))
            self._camera_pub.publish(convert.pose_stamped(_WORLD_FRAME, frame["stamp_ns"], T_world_cam))
        if not self._closing:
            rospy.logfatal("the rendering process has ended")
            rospy.signal_shutdown("no camera")

    def _publish_truth(self) -> None:
        state = self._plant.state
        stamp_ns = self._start_ns + state.time_ns
        v = omega = 0.0
        if self._before is not None and state.time_ns > self._before[0]:
            dt_s = (state.time_ns - self._before[0]) * 1e-9
            moved = self._before[1].inverse() @ state.T_world_base
            v, omega = moved.x / dt_s, moved.theta / dt_s
        self._before = state.time_ns, state.T_world_base
        truth = Odometry(stamp_ns, state.T_world_base, v, omega)
        self._truth_pub.publish(convert.odometry_msg(truth, _WORLD_FRAME, topics.BASE_FRAME))
        if self._plant.collisions != self._collisions:
            self._collisions = self._plant.collisions
            self._collisions_pub.publish(UInt32(self._collisions))
        if self._plant.min_clearance_m < self._clearance_m:
            self._clearance_m = self._plant.min_clearance_m
            self._clearance_pub.publish(Float32(self._clearance_m))

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
        self._closing = True
        self._base.close()
        if self._child.stdin is not None:
            self._child.stdin.close()
        try:
            self._child.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._child.kill()


def _file_param(name: str, default: str) -> str:
    """A path; the default lies in the folder for temporary files."""
    return str(rospy.get_param(name, os.path.join(tempfile.gettempdir(), default)))


def main() -> None:
    """Entry point of scripts/emulator."""
    node.run("emulator", EmulatorNode)
