"""The emulated world under the emulated devices: the body as wheels for a board, the camera in a process of its own."""

from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import PlantState
from vsx_ros.config import RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.body import Body
from vsx_ros.sim.settings import SimulationConfig
from vsx_ros.sim.world import World, obstacle_segments

_RATE_WINDOW_NS = 20_000_000
_SECTORS = Hazard.BUMPER_LEFT, Hazard.BUMPER_CENTER, Hazard.BUMPER_RIGHT


class BodyState(NamedTuple):
    """The truth at one instant since the emulator's start."""

    time_ns: int
    T_world_base: SE2
    path_length_m: float


class BodyPlant:
    """``vsx_hw.serial_emulator.Plant`` over the emulated body; only the emulator's thread calls it. ``state`` and the
    counts of ``body`` may be read from anywhere. ``on_step`` is called after each step."""

    def __init__(
        self, world: World, seed: int, robot: RobotConfig, on_step: Callable[[BodyState], None], wheel_base_m: float
    ) -> None:
        settings = msgspec.structs.replace(SimulationConfig().body, wheel_base_m=wheel_base_m)
        rng = np.random.default_rng([seed, 1])  # as in the lock-step robot
        segments = obstacle_segments(world, 0.0, robot.height_m)
        self._settings = settings
        self.body = Body(segments, world.start_pose, robot.radius_m, settings, rng)
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
        """See Plant. The rate is that of the gyro's angle over the last 20 ms."""
        body, tick_m = self.body, self._settings.tick_m
        then_ns, angle_before = self._gyro_before
        if body.time_ns - then_ns >= _RATE_WINDOW_NS:
            self._rate_rad_s = (body.gyro_angle_rad - angle_before) / (body.time_ns - then_ns) * 1e9
            self._gyro_before = body.time_ns, body.gyro_angle_rad
        left, right = body.encoders()
        hazards = Hazard(sum(sector for sector, pressed in zip(_SECTORS, body.bumper) if pressed))
        return PlantState(left * tick_m, right * tick_m, body.gyro_angle_rad, self._rate_rad_s, hazards)

    def _state(self) -> BodyState:
        return BodyState(self.body.time_ns, self.body.T_world_base, self.body.path_length_m)
