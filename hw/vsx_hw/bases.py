"""The three kinds of base by name: their speed on the wire, their language, their drivers."""

from collections.abc import Callable
from typing import NamedTuple

from vsx_hw.base_driver import BaseDriver, Dialect
from vsx_hw.create.driver import Create1Dialect, Create2Dialect
from vsx_hw.create.protocol import CREATE_1, CREATE_2
from vsx_hw.kobuki.base_control import WHEEL_BASE_M as KOBUKI_WHEEL_BASE_M
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import BAUD as KOBUKI_BAUD
from vsx_hw.readings import BaseReading
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import StopBytes


class Base(NamedTuple):
    """One kind. dialect: its language, made from the factors on measured distance and on measured turn."""

    baud: int
    wheel_base_m: float
    dialect: Callable[[float, float], Dialect]

    def stop_bytes(self) -> StopBytes:
        """What stops it, without a driver."""
        dialect = self.dialect(1.0, 1.0)
        return StopBytes(dialect.halt(), dialect.farewell())


BASES = {
    "kobuki": Base(KOBUKI_BAUD, KOBUKI_WHEEL_BASE_M, KobukiDialect),
    CREATE_1.name: Base(CREATE_1.baud, CREATE_1.wheel_base_m, Create1Dialect),
    CREATE_2.name: Base(CREATE_2.baud, CREATE_2.wheel_base_m, Create2Dialect),
}


def base_driver(
    kind: str,
    port: str,
    on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None] = lambda connected, message: None,
    command_timeout_s: float = 0.25,
    scales: tuple[float, float] = (1.0, 1.0),
    on_command: Callable[[bool], None] = lambda turning: None,
    allow_unknown_firmware: bool = False,
) -> BaseDriver:
    """A driver for the base of this kind at a serial port such as /dev/kobuki; call ``start`` on it.

    scales: factors on measured distance and on measured turn. allow_unknown_firmware: of a Kobuki; otherwise it stands.
    Raises KeyError for a kind that is not in BASES.
    """
    base = BASES[kind]
    dialect = base.dialect(*scales)
    if isinstance(dialect, KobukiDialect):
        dialect.allow_unknown_firmware = allow_unknown_firmware
    return BaseDriver(
        dialect, lambda: SerialTransport(port, base.baud), port, on_reading, on_link, command_timeout_s, on_command
    )
