"""Wheels that know where they are, before a dock."""

import math

from hw_plant import FreeWheels

from vsx_hw.dock_emulator import BaseAtDock
from vsx_hw.serial_emulator import PlantState


class WheelsAtDock(FreeWheels):
    """Wheels at a pose (x, y [m], heading [rad]) in the frame of the dock; there is nothing they could touch."""

    def __init__(self, wheel_base_m: float, x_m: float, y_m: float = 0.0, heading_rad: float = math.pi) -> None:
        super().__init__(wheel_base_m)
        self.at = BaseAtDock(x_m, y_m, heading_rad)

    def advance(self, dt_ns: int) -> None:
        super().advance(dt_ns)
        step_m = 0.5 * sum(self.speeds) * dt_ns * 1e-9
        turn = (self.speeds[1] - self.speeds[0]) / self.wheel_base_m * dt_ns * 1e-9
        x, y, heading = self.at[:3]
        self.at = self.at._replace(
            x_m=x + step_m * math.cos(heading), y_m=y + step_m * math.sin(heading), heading_rad=heading + turn
        )

    def read(self) -> PlantState:
        return super().read()._replace(dock=self.at)
