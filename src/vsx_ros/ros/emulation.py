"""The emulated world behind the emulated devices. The body drives the board's wheels. The camera is a separate process,
because rendering must not delay the wheels. No ROS in here.

The child reads poses of the base from standard input (``POSE``, one every 5 ms). It renders each frame when its
exposure is over and sends it through the emulated Kinect at a socket. For each frame it writes one line of JSON to
standard output: stamp, true camera pose, render time, frames skipped. It ends when its input ends."""

import contextlib
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec
import numpy as np

from vsx_hw.dock_emulator import BaseAtDock
from vsx_hw.kinect.emulator import KinectEmulator
from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import PlantState
from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import RobotConfig
from vsx_ros.errors import VsxError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.runs.journal import flat
from vsx_ros.runs.world import open_world
from vsx_ros.sim.body import Body
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.robot import SimulationConfig

POSE = struct.Struct("<q4d")  # Time since the emulator's start [ns], x, y [m], theta [rad], travelled path [m]
_KEPT = 600  # poses, for images that are rendered late
_RATE_WINDOW_NS = 20_000_000  # emulated time over which the turn rate is averaged: one odometry period
_WALLS_WITHIN_M = 4.0  # of the dock: those that may reflect its light
DOCK_FRONT_M, _DOCK_HALF_WIDTH_M = (
    0.03,
    0.1,
)  # of its housing, before its emitters; the body's radius before that: seated
_SECTORS = Hazard.BUMPER_LEFT, Hazard.BUMPER_CENTER, Hazard.BUMPER_RIGHT


class BodyState(NamedTuple):
    """The truth at one instant since the emulator's start."""

    time_ns: int
    T_world_base: SE2
    path_length_m: float


class BodyPlant:
    """``vsx_hw.serial_emulator.Plant`` for the emulated body; only the emulator's thread calls it. Any thread may read
    ``state`` and the counters of ``body``. ``on_step`` is called after each step."""

    def __init__(
        self,
        world: EmulatedWorld,
        seed: int,
        robot: RobotConfig,
        on_step: Callable[[BodyState], None],
        wheel_base_m: float,
        dock: SE2 | None = None,
    ) -> None:
        """dock: where one stands in the world, as ``vsx_hw.dock_emulator`` says."""
        settings = msgspec.structs.replace(SimulationConfig().body, wheel_base_m=wheel_base_m)
        rng = np.random.default_rng([seed, 1])  # as in the lock-step robot
        segments = world.obstacle_segments(0.0, robot.height_m)
        self._settings = settings
        self._dock, self.at_dock = dock, None if dock is None else before_dock(dock, world.start_pose, segments)
        solid = segments if dock is None else np.vstack([segments, housing(dock)])
        self.body = Body(solid, world.start_pose, robot.radius_m, settings, rng)
        self._on_step = on_step
        self._gyro_before = (0, 0.0)
        self._rate_rad_s = 0.0
        self.state = self._state()

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        """See Plant."""
        self.body.set_wheel_speeds(left_m_s, right_m_s)

    def advance(self, dt_ns: int) -> None:
        """See Plant."""
        self.body.advance(dt_ns)
        self.state = self._state()
        self._on_step(self.state)

    def read(self) -> PlantState:
        """See Plant. The rate is the change of the gyro's angle over the last 20 ms."""
        body, tick_m = self.body, self._settings.tick_m
        then_ns, angle_before = self._gyro_before
        if body.time_ns - then_ns >= _RATE_WINDOW_NS:
            self._rate_rad_s = (body.gyro_angle_rad - angle_before) / (body.time_ns - then_ns) * 1e9
            self._gyro_before = body.time_ns, body.gyro_angle_rad
        left, right = body.encoders()
        hazards = Hazard(sum(sector for sector, pressed in zip(_SECTORS, body.bumper) if pressed))
        if self._dock is not None and self.at_dock is not None:
            x, y, heading = (self._dock.inverse() @ body.T_world_base).as_array().tolist()
            self.at_dock = self.at_dock._replace(x_m=x, y_m=y, heading_rad=heading)
        return PlantState(
            left * tick_m, right * tick_m, gyro_rad=body.gyro_angle_rad, gyro_rate_rad_s=self._rate_rad_s,
            hazards=hazards, dock=self.at_dock,
        )  # fmt: skip

    def _state(self) -> BodyState:
        return BodyState(self.body.time_ns, self.body.T_world_base, self.body.path_length_m)


def before_dock(dock: SE2, base: SE2, segments: FloatArray) -> BaseAtDock:
    """A base before a dock, with the walls (N, 4) around it; poses in the world."""
    ends = (dock.inverse() @ segments.reshape(-1, 2)).reshape(-1, 4)
    near = np.minimum(np.hypot(ends[:, 0], ends[:, 1]), np.hypot(ends[:, 2], ends[:, 3])) < _WALLS_WITHIN_M
    x, y, heading = (dock.inverse() @ base).as_array().tolist()
    return BaseAtDock(x, y, heading, tuple(map(tuple, ends[near].tolist())))


def housing(dock: SE2) -> FloatArray:
    """(3, 4) front and sides of a dock in the world: what the bumper of a seated base touches."""
    front, half = DOCK_FRONT_M, _DOCK_HALF_WIDTH_M
    corners = dock @ np.array([[front - 0.1, -half], [front, -half], [front, half], [front - 0.1, half]])
    return np.hstack([corners[:-1], corners[1:]])


class RenderSettings(msgspec.Struct, frozen=True):
    """Settings for the child process. start_ns: host time at the emulator's start."""

    world: str
    seed: int
    socket: str
    rate_hz: float
    start_ns: int
    robot: RobotConfig


class RenderChild:
    """The parent's side."""

    def __init__(self, settings: RenderSettings) -> None:
        self._closing = False
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-m", "vsx_ros.ros.emulation", msgspec.json.encode(settings).decode()]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment, bufsize=0)

    def move(self, state: BodyState) -> None:
        """Send the pose of the base to the camera."""
        assert self._process.stdin is not None
        pose = state.T_world_base
        with contextlib.suppress(OSError):
            self._process.stdin.write(POSE.pack(state.time_ns, pose.x, pose.y, pose.theta, state.path_length_m))

    def listen(self, on_frame: Callable[[dict[str, Any]], None]) -> None:
        """Pass on a dictionary per frame until the end. Raises VsxError if the child ends before ``close``."""
        assert self._process.stdout is not None
        for line in iter(self._process.stdout.readline, b""):
            on_frame(json.loads(line))
        if not self._closing:
            raise VsxError("the rendering process has ended")

    def close(self) -> None:
        """End the child."""
        assert self._process.stdin is not None
        self._closing = True
        self._process.stdin.close()
        try:
            self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()


class PoseHistory:
    """Poses of the base over the last three seconds; one thread writes, another reads."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._rows = np.empty((0, 5))
        self._ended = False

    def fill(self, stream: BinaryIO) -> None:
        """Read until the stream ends."""
        while len(row := stream.read(POSE.size)) == POSE.size:
            with self._changed:
                self._rows = np.concatenate([self._rows, [POSE.unpack(row)]])[-_KEPT:]
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def wait_for(self, time_ns: int) -> int:
        """Wait until the poses reach this time. Returns the newest time, or -1 when no more will come."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended or (len(self._rows) > 0 and self._rows[-1, 0] >= time_ns))
            return -1 if self._ended else int(self._rows[-1, 0])

    def poses_at(self, stamps_ns: IntArray) -> FloatArray:
        """(N, 4) x, y, theta, path at the stamps, as ``Body.poses_at``."""
        rows = self._rows
        return np.column_stack([np.interp(stamps_ns, rows[:, 0], rows[:, k]) for k in range(1, 5)])


def render(settings: RenderSettings, history: PoseHistory) -> None:
    """Render frames every 1 / rate_hz until the history ends; frames that are too late are skipped and counted."""
    rng = np.random.default_rng([settings.seed, 2])  # as in the lock-step robot
    world = open_world(settings.world, settings.seed)
    optics = msgspec.structs.replace(SimulationConfig().camera, samples=1)  # for time
    camera = EmulatedCamera(scene_of(world), settings.robot.mount, optics, rng)
    write_calibration(Path(settings.socket + ".yaml"), camera.camera_given, "emulated")
    history.wait_for(0)
    camera.picture(0, history.poses_at, bayer=True)
    period_ns = 1e9 / settings.rate_hz
    slot = 0
    with KinectEmulator(settings.socket, settings.seed) as kinect:
        while (now_ns := history.wait_for(round((slot + 1) * period_ns) + camera.span_ns)) >= 0:
            newest = int((now_ns - camera.span_ns) / period_ns)
            skipped, slot = newest - slot - 1, newest
            if not kinect.streaming:
                continue
            stamp_ns = round(slot * period_ns)
            began_s = time.perf_counter()
            image = camera.render_bayer(stamp_ns, history.poses_at)
            render_ms = (time.perf_counter() - began_s) * 1e3
            if kinect.send_frame(image, settings.start_ns + stamp_ns):
                R, t = camera.poses_cam(history.poses_at(np.array([stamp_ns])))
                line = {"stamp_ns": settings.start_ns + stamp_ns, "T_world_cam": flat(SE3(R[0], t[0]))}
                sys.stdout.write(json.dumps({**line, "render_ms": render_ms, "skipped": skipped}) + "\n")
                sys.stdout.flush()


def main() -> None:
    """The only argument holds the settings as JSON."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = msgspec.json.decode(sys.argv[1], type=RenderSettings)
    history = PoseHistory()
    threading.Thread(target=history.fill, args=(sys.stdin.buffer,), daemon=True).start()
    render(settings, history)


if __name__ == "__main__":
    main()
