"""What the tests of the drivers share: wheels without a world, a base with its driver above them, and waiting."""

import contextlib
import queue

from waiting import wait_for

from vsx_hw.bases import BASES, base_driver, base_emulator
from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import PlantState


class FreeWheels:
    """The simplest plant: speeds are reached at once; ``hazards`` may be set by the test."""

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


class Rig:
    """An emulated base with its driver; ``twist`` is commanded at every reading while it is set.

    driver_kind: the kind that the driver believes in, where it is not the true one.
    """

    def __init__(self, kind: str, port: str, driver_kind: str = "") -> None:
        self.kind = kind
        self.plant = FreeWheels(BASES[kind].wheel_base_m)
        self.emulator = base_emulator(kind, self.plant, port, seed=4)
        self.board = self.emulator._board
        self.readings: queue.Queue = queue.Queue()
        self.twist = None
        self.driver = base_driver(driver_kind or kind, port, self.on_reading)

    def on_reading(self, reading) -> None:
        if self.twist is not None:
            self.driver.drive(*self.twist)
        self.readings.put(reading)

    def wait(self, condition):
        """The first reading from now on for which the condition holds."""

        def next_good():
            with contextlib.suppress(queue.Empty):
                reading = self.readings.get(timeout=0.1)
                return reading if condition(reading) else None

        return wait_for(next_good, "a reading", self.driver.status, 0.0)
