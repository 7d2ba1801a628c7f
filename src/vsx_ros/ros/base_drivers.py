"""The three bases by their names: drivers for the node mobile_base, emulators for the node emulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from vsx_hw import bases, emulators
from vsx_hw.base_driver import BaseDriver
from vsx_hw.guardian import Guardians
from vsx_hw.readings import BaseReading
from vsx_hw.serial_emulator import Plant, SerialEmulator
from vsx_ros.errors import ConfigError


class BaseSettings(NamedTuple):
    """What a user says about his base: kind, port, timeout of a command, calibration factors, unknown firmware."""

    robot_type: str
    port: str
    command_timeout_s: float = 0.25
    linear_scale: float = 1.0
    angular_scale: float = 1.0
    allow_unknown_firmware: bool = False


def base_driver(
    settings: BaseSettings,
    on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None],
    on_command: Callable[[bool], None],
) -> BaseDriver:
    """The driver of a base; it connects when started. Raises ConfigError for an unknown robot_type."""
    robot_type, port, timeout_s, linear, angular, allow = settings
    _base(robot_type)
    return bases.base_driver(robot_type, port, on_reading, on_link, timeout_s, (linear, angular), on_command, allow)


def base_emulator(robot_type: str, plant: Plant, link: str, seed: int) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``. Raises ConfigError for an unknown robot_type."""
    _base(robot_type)
    return emulators.base_emulator(robot_type, plant, link, seed)


def base_guardians(robot_type: str, port: str) -> Guardians:
    """The processes that stop the base should this one die or hang. Raises ConfigError for an unknown robot_type."""
    base = _base(robot_type)
    return Guardians(port, base.baud, base.stop_bytes())


def wheel_base_m(robot_type: str) -> float:
    """Distance between the wheels [m]. Raises ConfigError for an unknown robot_type."""
    return _base(robot_type).wheel_base_m


def _base(robot_type: str) -> bases.Base:
    if robot_type not in bases.BASES:
        raise ConfigError(f"~robot_type {robot_type!r}: give {', '.join(bases.BASES)} or auto")
    return bases.BASES[robot_type]
