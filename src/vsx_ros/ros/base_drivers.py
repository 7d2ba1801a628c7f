"""The three bases by their names: drivers for the node mobile_base, emulators for the node emulator."""

from __future__ import annotations

from collections.abc import Callable

from vsx_hw.base_driver import BaseDriver
from vsx_hw.kobuki.base_control import WHEEL_BASE_M as KOBUKI_WHEEL_BASE_M
from vsx_hw.kobuki.driver import kobuki_driver
from vsx_hw.kobuki.emulator import kobuki_emulator
from vsx_hw.readings import BaseReading
from vsx_hw.serial_emulator import Plant, SerialEmulator
from vsx_ros.errors import ConfigError


def base_driver(
    robot_type: str,
    port: str,
    on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None],
    command_timeout_s: float,
    linear_scale: float,
    angular_scale: float,
) -> BaseDriver:
    """The driver of a base; it connects when started. Raises ConfigError for an unknown robot_type."""
    if robot_type == "kobuki":
        return kobuki_driver(port, on_reading, on_link, command_timeout_s, linear_scale, angular_scale)
    raise _unknown(robot_type)


def base_emulator(robot_type: str, plant: Plant, link: str, seed: int) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``. Raises ConfigError for an unknown robot_type."""
    if robot_type == "kobuki":
        return kobuki_emulator(plant, link, seed)
    raise _unknown(robot_type)


def wheel_base_m(robot_type: str) -> float:
    """Distance between the wheels [m]. Raises ConfigError for an unknown robot_type."""
    if robot_type == "kobuki":
        return KOBUKI_WHEEL_BASE_M
    raise _unknown(robot_type)


def _unknown(robot_type: str) -> ConfigError:
    return ConfigError(f"~robot_type {robot_type!r}: give kobuki, create or create2")
