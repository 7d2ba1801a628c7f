"""A program that drives a base as the node does: each reading is answered with the supervisor's decision at once."""

import time
from collections import deque

from documented_line import Line
from waiting import wait_for

from vsx_hw.base_driver import BaseDriver
from vsx_hw.bases import base_driver
from vsx_hw.readings import BaseReading, Signal
from vsx_hw.safety import Source, SpeedLimits, Supervisor


class Host:
    """Driver and supervisor; a context manager. `want` is what the navigator says again with each reading."""

    def __init__(self, kind: str, line: Line, timeout_s: float = 0.25) -> None:
        self.line = line
        self.want = (0.0, 0.0)
        self.talks = True
        self.readings: deque[BaseReading] = deque(maxlen=1000)
        self.count = 0
        self.links: list[tuple[bool, str]] = []
        self.supervisor = Supervisor(SpeedLimits(0.7, 3.0), (Source("navi", 5, timeout_s),))
        self.driver: BaseDriver = base_driver(kind, line.link, self._on_reading, self._on_link, timeout_s)

    def __enter__(self) -> "Host":
        self.driver.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.close()

    def _on_link(self, connected: bool, message: str) -> None:
        self.supervisor.forget_commands()
        self.links.append((connected, message))

    def _on_reading(self, reading: BaseReading) -> None:
        self.readings.append(reading)
        self.count += 1
        now_ns = time.monotonic_ns()
        if self.talks:
            self.supervisor.command("navi", *self.want, now_ns)
        decision = self.supervisor.decide(now_ns, reading.hazards)
        self.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)
        held = bool(decision.reason and decision.source)
        locked = self.supervisor.locked
        self.driver.show(Signal.ALARM if locked else Signal.HELD if held else Signal.READY)

    @property
    def last(self) -> BaseReading:
        return self.readings[-1]

    def connected(self) -> None:
        """Wait for the first reading, and one more."""
        self.wait_readings(2)

    def wait_readings(self, number: int) -> None:
        """Wait for so many more readings."""
        goal = self.count + number
        wait_for(lambda: self.count >= goal, f"{number} more readings; link {self.links[-3:]}")

    def settle(self, readings: int = 10) -> None:
        """Stop, and wait until the body stands and the driver has heard of it in so many readings."""
        self.want = (0.0, 0.0)
        body = self.line.robot.body
        wait_for(lambda: body.left_m_s == body.right_m_s == 0.0, "standstill")
        self.wait_readings(readings)
