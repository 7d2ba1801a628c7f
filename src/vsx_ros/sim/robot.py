"""The emulated robot in lock-step: one command in, one image and one odometry out; the truth is separate."""

from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from vsx_ros.config import RobotConfig
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2, integrate, wheel_speeds
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry, VelocityCommand
from vsx_ros.sim.body import Body, BodySettings, Contacts
from vsx_ros.sim.camera import CameraSettings, EmulatedCamera
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.hard_settings import body_in, camera_in
from vsx_ros.sim.mitsuba_variant import mitsuba
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.moving import Moving
from vsx_ros.sim.optics import scene_of

ODOMETRY_PERIOD_NS = 20_000_000  # 50 Hz, as a Kobuki


class SimulationConfig(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Properties of the emulated robot, which the stack under test never sees. frame_rate_hz applies in lock-step."""

    frame_rate_hz: Annotated[float, Meta(ge=1, le=20)] = 15.0
    threads: Annotated[int, Meta(ge=1, le=64)] = 1
    body: BodySettings = BodySettings()
    camera: CameraSettings = CameraSettings()


RASTER = "raster"
_LOCK_STEP = SimulationConfig(threads=2)
_MITSUBA_RATE_HZ = 5.0  # an image takes seconds


def simulation_of(eye: str) -> SimulationConfig:
    """The emulated robot in lock-step with this eye. Raises ConfigError if there is none of that name, or it does not
    work here."""
    if eye == RASTER:
        return _LOCK_STEP
    if eye != "mitsuba":
        raise ConfigError(f"there is no eye {eye!r:.60}; choose raster or mitsuba")
    mitsuba()
    return replace(_LOCK_STEP, frame_rate_hz=_MITSUBA_RATE_HZ, camera=replace(_LOCK_STEP.camera, eye="mitsuba"))


class Observation(NamedTuple):
    """The stack's input; the odometry is at the frame's stamp."""

    frame: Frame
    odometry: Odometry


class Truth(NamedTuple):
    """The true state at the last frame's stamp; for evaluation only. Lengths in metres."""

    stamp_ns: int
    T_world_base: SE2
    T_world_cam: SE3
    path_length_m: float
    collisions: int
    contacts: Contacts
    min_clearance_m: float


class WheelOdometry:
    """Odometry as a base driver computes it: distance from the encoder ticks, heading from the gyro. It also gives the
    turn by the wheels, for the driver's wheel_base_m."""

    def __init__(self, tick_m: float, wheel_base_m: float) -> None:
        self._tick_m, self._wheel_base_m = tick_m, wheel_base_m
        self._ticks = (0, 0)
        self._angle = 0.0
        self._stamp_ns = 0
        self.latest = Odometry(0, SE2())

    def update(self, stamp_ns: int, ticks: tuple[int, int], gyro_angle: float) -> None:
        """Add a reading: ticks since the start, gyro angle [rad], both not wrapped."""
        elapsed = (stamp_ns - self._stamp_ns) * 1e-9
        if elapsed <= 0.0:
            return
        distance = 0.5 * self._tick_m * (ticks[0] - self._ticks[0] + ticks[1] - self._ticks[1])
        turn = gyro_angle - self._angle
        pose = integrate(self.latest.T_odom_base, distance, turn)
        wheel_turn = self._tick_m * (ticks[1] - ticks[0]) / self._wheel_base_m
        self.latest = Odometry(stamp_ns, pose, distance / elapsed, turn / elapsed, wheel_turn=wheel_turn)
        self._ticks, self._angle, self._stamp_ns = ticks, gyro_angle, stamp_ns


class EmulatedRobot:
    """A robot in a world. camera_given and T_base_cam_given, slightly wrong, are for the stack; images are made with
    the _true ones. truth: at the last frame's stamp; collisions and clearance up to now."""

    def __init__(
        self,
        world: EmulatedWorld,
        seed: int,
        config: SimulationConfig = SimulationConfig(),  # noqa: B008 (immutable)
        robot: RobotConfig = RobotConfig(),  # noqa: B008 (immutable)
    ) -> None:
        """Raises ConfigError when the frame period is shorter than exposure and readout."""
        body_rng, camera_rng = (np.random.default_rng([seed, child]) for child in (1, 2))
        camera, body = camera_in(world.hard, seed, config.camera), body_in(world.hard, config.body)
        late = replace(body, latency_ns=body.latency_ns + camera.delay_ns)  # the answer to a late image is late
        segments = world.obstacle_segments(0.0, robot.height_m)
        movers = movers_of(world, seed)
        moving = Moving(movers) if movers else None
        self.body = Body(segments, world.start_pose, robot.radius_m, late, body_rng, moving)
        self.camera = EmulatedCamera(scene_of(world, movers), robot.mount, camera, camera_rng, config.threads)
        period_ns = round(1e9 / config.frame_rate_hz)
        if self.camera.span_ns > period_ns:
            raise ConfigError(
                f"simulation: a frame takes {self.camera.span_ns / 1e6:.0f} ms to expose and read out, longer than the "
                f"{period_ns / 1e6:.0f} ms between frames; lower frame_rate_hz or the exposure"
            )
        self._config = config
        self._odometry = WheelOdometry(config.body.tick_m, config.body.wheel_base_m)
        self._frames = 0
        self.camera_given, self.camera_true = self.camera.camera_given, self.camera.camera_true
        self.T_base_cam_given, self.T_base_cam_true = self.camera.T_base_cam_given, self.camera.T_base_cam_true
        self.truth = self._read_truth(0)

    def step(self, command: VelocityCommand) -> Observation:
        """Drive by the command until the next frame is read out that is not lost, and return the observation. The
        command is sent when the last frame has been read out. Raises InputError when it is not finite."""
        body, base = self.body, self._config.body
        body.set_wheel_speeds(*wheel_speeds(command.v, command.omega, base.wheel_base_m))
        self._frames += 1
        while self.camera.loses_image():
            self._frames += 1
        stamp_ns = round(self._frames * 1e9 / self._config.frame_rate_hz)
        odometry = self._drive_until(stamp_ns)
        self._drive_until(stamp_ns + self.camera.span_ns)
        image = self.camera.render_gray(stamp_ns, body.poses_at)
        self.truth = self._read_truth(stamp_ns)
        return Observation(Frame(stamp_ns, image), odometry)

    def _drive_until(self, stamp_ns: int) -> Odometry:
        while self.body.time_ns < stamp_ns:
            self.body.advance(min(ODOMETRY_PERIOD_NS, stamp_ns - self.body.time_ns))
            self._odometry.update(self.body.time_ns, self.body.encoders(), self.body.gyro_angle_rad)
        return self._odometry.latest

    def _read_truth(self, stamp_ns: int) -> Truth:
        base = self.body.poses_at(np.array([stamp_ns]))
        R, t = self.camera.poses_cam(base)
        x, y, theta, path = (float(v) for v in base[0, :4])
        body = self.body
        return Truth(
            stamp_ns=stamp_ns,
            T_world_base=SE2(x, y, theta),
            T_world_cam=SE3(R[0], t[0]),
            path_length_m=path,
            collisions=body.collisions,
            contacts=body.contacts,
            min_clearance_m=body.min_clearance_m,
        )
