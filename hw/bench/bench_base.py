"""The base at a port, whatever it is, for the scripts beside this file."""

from __future__ import annotations

from collections.abc import Callable

from vsx_hw.base_driver import BaseDriver, Dialect
from vsx_hw.create.driver import create_dialect
from vsx_hw.create.protocol import CREATE_1, CREATE_2
from vsx_hw.detect import detect_base
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import BAUD as KOBUKI_BAUD
from vsx_hw.readings import BaseReading
from vsx_hw.transport import SerialTransport


class BenchBase:
    """Finds the base and says what it found; ``driver`` makes its driver."""

    def __init__(self, port: str) -> None:
        self.port, kind = port, detect_base(port)
        print(f"{port}: {kind}", flush=True)
        model = {m.name: m for m in (CREATE_1, CREATE_2)}.get(kind)
        self.baud = KOBUKI_BAUD if model is None else model.baud
        self.dialect: Dialect = KobukiDialect() if model is None else create_dialect(model)

    def driver(
        self,
        on_reading: Callable[[BaseReading], None],
        on_command: Callable[[bool], None] = lambda turning: None,
    ) -> BaseDriver:
        """Call ``start`` on it, or use it as a context manager."""
        return BaseDriver(
            self.dialect,
            lambda: SerialTransport(self.port, self.baud),
            self.port,
            on_reading,
            on_command=on_command,
        )
