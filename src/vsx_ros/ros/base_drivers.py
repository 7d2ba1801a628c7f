"""Bases by name: drivers for the node mobile_base, emulators for the node emulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from vsx_hw import bases, emulators
from vsx_hw.readings import BaseReading, LinkStatus, Signal
from vsx_hw.serial_emulator import Plant, SerialEmulator
from vsx_hw.watchdog import Watchdogs
from vsx_ros.errors import ConfigError
from vsx_ros.registry import Registry
from vsx_ros.ros.topic_base import NoWatchdogs, TopicBase, TopicNames


class Base(Protocol):
    """A driver: readings come on a thread of its own, and ``drive`` within one reaches the wheels at once."""

    def start(self) -> None:
        """Begin connecting; returns at once."""

    def drive(self, v_m_s: float, omega_rad_s: float, until_ns: int | None = None) -> None:
        """Move like this until the next command, at most until the timeout or the instant until_ns (monotonic)."""

    def show(self, signal: Signal) -> None:
        """Lamp and sound, where it has any."""

    def reset_odometry(self) -> None:
        """Start the pose again at the origin. Raises DeviceError where it cannot."""

    def status(self) -> LinkStatus:
        """Health for diagnostics."""

    def close(self) -> bool:
        """Stop the wheels and let go; whether they surely stand."""


class BaseSettings(NamedTuple):
    """What a user says about his base: kind, port, timeout of a command, calibration factors, unknown firmware."""

    robot_type: str
    port: str
    command_timeout_s: float = 0.25
    linear_scale: float = 1.0
    angular_scale: float = 1.0
    allow_unknown_firmware: bool = False


class Listeners(NamedTuple):
    """Who hears of a base: each reading; (connected, message) at every change; whether the wheels turn, after each
    command."""

    on_reading: Callable[[BaseReading], None]
    on_link: Callable[[bool, str], None]
    on_command: Callable[[bool], None]


def _serial(kind: str) -> Callable[[BaseSettings, Listeners], Base]:
    def driver(settings: BaseSettings, hears: Listeners) -> Base:
        _, port, timeout_s, linear, angular, allow = settings
        scales = linear, angular
        return bases.base_driver(
            kind, port, hears.on_reading, hears.on_link, timeout_s, scales, hears.on_command, allow
        )

    return driver


def _over_topics(settings: BaseSettings, hears: Listeners) -> Base:
    names = TopicNames.of(settings.robot_type.partition(":")[2])
    return TopicBase(names, hears.on_reading, hears.on_link, settings.command_timeout_s)


BASES: Registry[Callable[[BaseSettings, Listeners], Base]] = Registry(
    "base", {**{kind: _serial(kind) for kind in bases.BASES}, "ros": _over_topics}
)


def base_driver(settings: BaseSettings, hears: Listeners) -> Base:
    """The driver of a base; it connects when started. Raises ConfigError for an unknown robot_type."""
    return BASES[settings.robot_type.partition(":")[0]](settings, hears)


def base_watchdogs(robot_type: str, port: str) -> Watchdogs | NoWatchdogs:
    """The processes that stop a base at a serial port should this one die or hang."""
    base = bases.BASES.get(robot_type)
    return NoWatchdogs() if base is None else Watchdogs(port, base.baud, base.stop_bytes())


def base_emulator(robot_type: str, plant: Plant, link: str, seed: int) -> SerialEmulator:
    """A base on emulated wheels behind the serial port ``link``. Raises ConfigError for one that is not emulated."""
    _wired(robot_type)
    return emulators.base_emulator(robot_type, plant, link, seed)


def wheel_base_m(robot_type: str) -> float:
    """Distance between the wheels [m]. Raises ConfigError for a base that is not emulated."""
    return _wired(robot_type).wheel_base_m


def _wired(robot_type: str) -> bases.Base:
    if robot_type not in bases.BASES:
        raise ConfigError(f"~robot_type {robot_type!r}: give {', '.join(bases.BASES)} or auto")
    return bases.BASES[robot_type]
