"""The emulated world behind the emulated devices. The body drives the board's wheels. The camera is a separate process,
because rendering must not delay the wheels. No ROS in here.

The child reads its settings, a line of JSON, then poses of the base and the movers (``pose_row``, one every 5 ms). It
renders each frame when its exposure is over and sends it through the emulated Kinect at a socket. For each frame it
writes one line of JSON: stamp, true camera pose, render time, frames skipped. It ends when its input ends."""

import contextlib
import json
import os
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import msgspec
import numpy as np

from vsx_hw.kinect.emulator import KinectEmulator
from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import RobotConfig
from vsx_ros.errors import VsxError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.ros.emulated_base import BodyState
from vsx_ros.runs.journal import flat
from vsx_ros.runs.world import open_world
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.hard_settings import camera_in
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.robot import SimulationConfig

_KEPT = 600  # poses, for images that are rendered late


def pose_row(moved: int) -> struct.Struct:
    """A row for the child: time since the emulator's start [ns], x, y [m], theta [rad], travelled path [m] of the base,
    and so many numbers of the movers' states."""
    return struct.Struct(f"<q{4 + moved}d")


class RenderSettings(msgspec.Struct, frozen=True):
    """Settings for the child process. hard: NAME=AMOUNT of hard things, beside the world's own. start_ns: host time at
    the emulator's start."""

    world: str
    seed: int
    hard: str
    socket: str
    rate_hz: float
    start_ns: int
    robot: RobotConfig


class RenderChild:
    """The parent's side. The child is a copy of this process from before it has threads; it waits for settings."""

    def __init__(self) -> None:
        self._closing = False
        poses, to_child = os.pipe()
        from_child, frames = os.pipe()
        self._poses, self._frames = os.fdopen(to_child, "wb", buffering=0), os.fdopen(from_child, "rb")

        def child() -> None:
            self._poses.close()
            self._frames.close()
            render_for(os.fdopen(poses, "rb"), os.fdopen(frames, "w", encoding="utf-8"))

        self._process = get_context("fork").Process(target=child, daemon=True)
        self._process.start()
        os.close(poses)
        os.close(frames)

    def begin(self, settings: RenderSettings) -> None:
        """Let the child load its world and make its socket."""
        self._write(msgspec.json.encode(settings) + b"\n")

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._poses.write(data)

    def move(self, state: BodyState) -> None:
        """Send the pose of the base to the camera."""
        pose = state.T_world_base
        base = pose.x, pose.y, pose.theta, state.path_length_m
        self._write(pose_row(len(state.moved)).pack(state.time_ns, *base, *state.moved))

    def listen(self, on_frame: Callable[[dict[str, Any]], None]) -> None:
        """Pass on a dictionary per frame until the end. Raises VsxError if the child ends before ``close``."""
        for line in iter(self._frames.readline, b""):
            on_frame(json.loads(line))
        if not self._closing:
            raise VsxError("the rendering process has ended")

    def close(self) -> None:
        """End the child."""
        self._closing = True
        self._poses.close()
        self._process.join(2.0)
        self._process.kill()


class PoseHistory:
    """Poses of the base over the last three seconds, and the movers' states (so many numbers); one thread writes,
    another reads."""

    def __init__(self, moved: int = 0) -> None:
        self._changed = threading.Condition()
        self._row = pose_row(moved)
        self._rows = np.empty((0, 5 + moved))
        self._ended = False

    def fill(self, stream: BinaryIO) -> None:
        """Read until the stream ends."""
        while len(row := stream.read(self._row.size)) == self._row.size:
            with self._changed:
                self._rows = np.concatenate([self._rows, [self._row.unpack(row)]])[-_KEPT:]
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
        """(N, 4 + K) x, y, theta, path and movers at the stamps, as ``Body.poses_at``."""
        rows = self._rows
        return np.column_stack([np.interp(stamps_ns, rows[:, 0], rows[:, k]) for k in range(1, rows.shape[1])])


def render(
    settings: RenderSettings, world: EmulatedWorld, movers: Sequence[Mover], history: PoseHistory, frames: TextIO
) -> None:
    """Render frames every 1 / rate_hz until the history ends; frames that are too late are skipped and counted."""
    rng = np.random.default_rng([settings.seed, 2])  # as in the lock-step robot
    optics = msgspec.structs.replace(SimulationConfig().camera, samples=1)  # for time
    optics = camera_in(world.hard, settings.seed, optics)
    camera = EmulatedCamera(scene_of(world, movers), settings.robot.mount, optics, rng)
    write_calibration(Path(settings.socket + ".yaml"), camera.camera_given, "emulated")
    history.wait_for(0)
    camera.picture(0, history.poses_at, bayer=True)
    period_ns = 1e9 / settings.rate_hz
    slot = 0
    with KinectEmulator(settings.socket, settings.seed) as kinect:
        late_ns = camera.span_ns + optics.delay_ns
        while (now_ns := history.wait_for(round((slot + 1) * period_ns) + late_ns)) >= 0:
            newest = int((now_ns - late_ns) / period_ns)
            skipped, slot = newest - slot - 1, newest
            if camera.loses_image() or not kinect.streaming:
                continue
            stamp_ns = round(slot * period_ns)
            began_s = time.perf_counter()
            image = camera.render_bayer(stamp_ns, history.poses_at)
            render_ms = (time.perf_counter() - began_s) * 1e3
            if kinect.send_frame(image, settings.start_ns + stamp_ns):
                R, t = camera.poses_cam(history.poses_at(np.array([stamp_ns])))
                line = {"stamp_ns": settings.start_ns + stamp_ns, "T_world_cam": flat(SE3(R[0], t[0]))}
                frames.write(json.dumps({**line, "render_ms": render_ms, "skipped": skipped}) + "\n")
                frames.flush()


def render_for(poses: BinaryIO, frames: TextIO) -> None:
    """The child: settings and poses come, lines about frames go."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not (line := poses.readline()):
        return
    settings = msgspec.json.decode(line, type=RenderSettings)
    world = open_world(settings.world, settings.seed, hard=[settings.hard])
    movers = movers_of(world, settings.seed)
    history = PoseHistory(sum(len(mover.state) for mover in movers))
    threading.Thread(target=history.fill, args=(poses,), daemon=True).start()
    render(settings, world, movers, history, frames)


if __name__ == "__main__":
    render_for(sys.stdin.buffer, sys.stdout)
