"""The base at a port, whatever it is, for the scripts beside this file."""

from collections.abc import Callable

from vsx_hw.base_driver import BaseDriver
from vsx_hw.bases import BASES, base_driver
from vsx_hw.detect import detect_base
from vsx_hw.readings import BaseReading


class BenchBase:
    """Finds the base and says what it found; ``driver`` makes its driver."""

    def __init__(self, port: str) -> None:
        self.port, self.kind = port, detect_base(port)
        print(f"{port}: {self.kind} at {BASES[self.kind].baud} baud", flush=True)

    def driver(
        self, on_reading: Callable[[BaseReading], None], on_command: Callable[[bool], None] = lambda turning: None
    ) -> BaseDriver:
        """Call ``start`` on it, or use it as a context manager."""
        return base_driver(self.kind, self.port, on_reading, on_command=on_command)
