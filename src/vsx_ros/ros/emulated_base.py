"""The emulated body in its world, as the wheels under an emulated base; and a dock there. Needs no ROS."""

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from vsx_hw.dock_emulator import BaseAtDock
from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import PlantState
from vsx_ros.arrays import FloatArray
from vsx_ros.config import RobotConfig
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.body import Body
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.hard_settings import body_in
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.moving import Moving
from vsx_ros.sim.robot import SimulationConfig

_RATE_WINDOW_NS = 20_000_000  # emulated time over which the turn rate is averaged: one odometry period
_WALLS_WITHIN_M = 4.0  # of the dock: those that may reflect its light
DOCK_FRONT_M, _DOCK_DEPTH_M, _DOCK_HALF_WIDTH_M = 0.03, 0.1, 0.1  # of its housing; front + a body's radius: its seat
_SECTORS = Hazard.BUMPER_LEFT, Hazard.BUMPER_CENTER, Hazard.BUMPER_RIGHT


class BodyState(NamedTuple):
    """The truth at one instant since the emulator's start."""

    time_ns: int
    T_world_base: SE2
    path_length_m: float
    moved: tuple[float, ...]  # states of the movers


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
        settings = body_in(world.hard, msgspec.structs.replace(SimulationConfig().body, wheel_base_m=wheel_base_m))
        rng = np.random.default_rng([seed, 1])  # as in the lock-step robot
        segments = world.obstacle_segments(0.0, robot.height_m)
        self._settings = settings
        self._dock, self.at_dock = dock, None if dock is None else before_dock(dock, world.start_pose, segments)
        solid = segments if dock is None else np.vstack([segments, housing(dock)])
        movers = movers_of(world, seed)
        self._moving = Moving(movers) if movers else None
        self.body = Body(solid, world.start_pose, robot.radius_m, settings, rng, self._moving)
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
        moved = () if self._moving is None else self._moving.state
        return BodyState(self.body.time_ns, self.body.T_world_base, self.body.path_length_m, moved)


def before_dock(dock: SE2, base: SE2, segments: FloatArray) -> BaseAtDock:
    """A base before a dock, with the walls (N, 4) around it; poses in the world. The wall that the dock stands at, or
    is let into, does not shade it."""
    ends = (dock.inverse() @ segments.reshape(-1, 2)).reshape(-1, 4)
    edge = ends[:, 2:] - ends[:, :2]
    along = np.clip(-(ends[:, :2] * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-12), 0.0, 1.0)
    distance_m = np.hypot(*(ends[:, :2] + along[:, None] * edge).T)
    around = (distance_m > _DOCK_DEPTH_M) & (distance_m < _WALLS_WITHIN_M)
    x, y, heading = (dock.inverse() @ base).as_array().tolist()
    return BaseAtDock(x, y, heading, tuple(map(tuple, ends[around].tolist())))


def housing(dock: SE2) -> FloatArray:
    """(3, 4) front and sides of a dock in the world: what the bumper of a seated base touches."""
    front, half = DOCK_FRONT_M, _DOCK_HALF_WIDTH_M
    back = front - _DOCK_DEPTH_M
    corners = dock @ np.array([[back, -half], [front, -half], [front, half], [back, half]])
    return np.hstack([corners[:-1], corners[1:]])


def dock_pose(text: str) -> SE2 | None:
    """The pose that ~dock says; None for an empty text. Raises ConfigError for anything else."""
    if not text:
        return None
    try:
        x, y, degrees = (float(word) for word in text.split(","))
        finite = math.isfinite(x + y + degrees)
    except ValueError:
        finite = False
    if not finite:
        raise ConfigError(f"~dock is {text!r}; write X,Y,DEG, e.g. 1.5,-2,90")
    return SE2(x, y, math.radians(degrees))
