"""The three bases by their names: drivers for the node mobile_base, emulators for the node emulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from vsx_hw.base_driver import BaseDriver
from vsx_hw.create.driver import create_dialect, create_driver
from vsx_hw.create.emulator import create_emulator
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Model
from vsx_hw.guardian import Guardian, StopBytes
from vsx_hw.kobuki.base_control import WHEEL_BASE_M as KOBUKI_WHEEL_BASE_M
from vsx_hw.kobuki.driver import KobukiDialect, kobuki_driver
from vsx_hw.kobuki.emulator import kobuki_emulator
from vsx_hw.kobuki.protocol import BAUD as KOBUKI_BAUD
from vsx_hw.readings import BaseReading
from vsx_hw.serial_emulator import Plant, SerialEmulator
from vsx_ros.errors import ConfigError


class BaseSettings(NamedTuple):
    """What a user says about his base: kind, port, timeout of a command, calibration factors."""

    robot_type: str
    port: str
    command_timeout_s: float = 0.25
    linear_scale: float = 1.0
    angular_scale: float = 1.0


def base_driver(
    settings: BaseSettings,
    on_reading: Callable[[BaseReading], None],
    on_link: Callable[[bool, str], None],
    on_command: Callable[[bool], None],
) -> BaseDriver:
    """The driver of a base; it connects when started. Raises ConfigError for an unknown robot_type."""
    robot_type, port, timeout_s, linear, angular = settings
    if robot_type == "kobuki":
        return kobuki_driver(port, on_reading, on_link, timeout_s, linear, angular, on_command)
    model = _create_model(robot_type)
    return create_driver(model, port, on_reading, on_link, timeout_s, linear, angular, on_command)


def base_emulator(robot_type: str, plant: Plant, link: str, seed: int) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``. Raises ConfigError for an unknown robot_type."""
    if robot_type == "kobuki":
        return kobuki_emulator(plant, link, seed)
    return create_emulator(_create_model(robot_type), plant, link, seed)


def base_guardian(robot_type: str, port: str) -> Guardian:
    """The process that stops the base should this one die or hang. Raises ConfigError for an unknown robot_type."""
    if robot_type == "kobuki":
        kobuki = KobukiDialect()
        return Guardian(port, KOBUKI_BAUD, StopBytes(kobuki.halt(), kobuki.farewell()))
    model = _create_model(robot_type)
    create = create_dialect(model)
    return Guardian(port, model.baud, StopBytes(create.halt(), create.farewell()))


def wheel_base_m(robot_type: str) -> float:
    """Distance between the wheels [m]. Raises ConfigError for an unknown robot_type."""
    return KOBUKI_WHEEL_BASE_M if robot_type == "kobuki" else _create_model(robot_type).wheel_base_m


def _create_model(robot_type: str) -> Model:
    for model in (CREATE_1, CREATE_2):
        if robot_type == model.name:
            return model
    raise ConfigError(f"~robot_type {robot_type!r}: give kobuki, create, create2 or auto")
