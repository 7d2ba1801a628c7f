"""Wheels without a world, for the emulators' tests: speeds reached at once."""

from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import PlantState


class FreeWheels:
    """The simplest plant; ``hazards`` may be set by the test."""

    def __init__(self, wheel_base_m: float) -> None:
        self.wheel_base_m = wheel_base_m
        self.speeds = (0.0, 0.0)
        self.travel = [0.0, 0.0]
        self.hazards = Hazard.NONE

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        self.speeds = (left_m_s, right_m_s)

    def advance(self, dt_ns: int) -> None:
        for side in (0, 1):
            self.travel[side] += self.speeds[side] * dt_ns * 1e-9

    def read(self) -> PlantState:
        left, right = self.travel
        rate = (self.speeds[1] - self.speeds[0]) / self.wheel_base_m
        return PlantState(left, right, (right - left) / self.wheel_base_m, rate, self.hazards)
