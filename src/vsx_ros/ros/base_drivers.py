"""Bases by name: parameters of mobile_base, drivers, and emulators for the node emulator."""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import rospy

from vsx_hw import bases
from vsx_hw.base_driver import BaseDriver, Dialect
from vsx_hw.errors import DeviceError
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.machine_sleep import keep_awake
from vsx_hw.readings import BaseReading, LinkStatus, Signal
from vsx_hw.safety import SOURCES, SpeedLimits, Supervisor
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import StopBytes, Watchdogs
from vsx_ros.config import Config, LimitsConfig
from vsx_ros.errors import ConfigError
from vsx_ros.registry import Registry
from vsx_ros.ros import logs, threads
from vsx_ros.ros.logs import ERROR, Diagnostics
from vsx_ros.ros.topic_base import TopicBase, TopicNames, topic_names


class Base(Protocol):
    """A driver. Readings come on its own thread; a ``drive`` called there reaches the wheels at once."""

    def start(self) -> None:
        """Begin connecting; returns at once."""

    def drive(self, v_m_s: float, omega_rad_s: float, until_ns: int | None = None) -> None:
        """Move like this until the next command, at most until the timeout or the instant until_ns (monotonic)."""

    def show(self, signal: Signal) -> None:
        """Set lamp and sound, if the base has any."""

    def reset_odometry(self) -> None:
        """Reset the pose to the origin. Raises DeviceError if the base cannot do this."""

    def status(self) -> LinkStatus:
        """Health for diagnostics, asked a few times a second on other threads, never twice at once. It may take its
        time: what it said last counts meanwhile."""

    def close(self) -> bool:
        """Stop the wheels and release the device; whether the wheels surely stand."""


class BaseSettings(NamedTuple):
    """The user's settings for the base: kind, port, command timeout, calibration factors, unknown firmware."""

    robot_type: str
    port: str
    command_timeout_s: float = 0.25
    linear_scale: float = 1.0
    angular_scale: float = 1.0
    allow_unknown_firmware: bool = False

    @property
    def factors(self) -> tuple[float, float]:
        """On measured distance and on measured turn."""
        return self.linear_scale, self.angular_scale

    @property
    def hardware_id(self) -> str:
        """Whose health the diagnostics tell: the port, the odometry topic of a base on topics, or the kind of another
        base without a port. Raises ConfigError for a robot_type that does not exist."""
        if (names := topic_names(self.robot_type)) is not None:
            return str(rospy.resolve_name(names.odometry))
        is_at_port = self.robot_type == "auto" or _entry(self.robot_type).stop is not None
        return self.port if is_at_port else self.robot_type


class Listeners(NamedTuple):
    """Callbacks of a base: each reading; (connected, message) at every change; whether the wheels turn, after each
    command."""

    on_reading: Callable[[BaseReading], None]
    on_link: Callable[[bool, str], None]
    on_command: Callable[[bool], None]


class BaseEntry(NamedTuple):
    """One kind of base. driver: makes it. stop, baud: of a base at the serial port ~port; its watchdogs send these
    bytes when the driver hangs or is dead."""

    driver: Callable[[BaseSettings, Listeners], Base]
    stop: StopBytes | None = None
    baud: int = 0


def at_port(baud: int, dialect: Callable[[float, float], Dialect]) -> BaseEntry:
    """A base at a serial port, with the driver that keeps the safety rules, and with watchdogs. dialect: makes its
    protocol from the factors on measured distance and on measured turn."""

    def driver(settings: BaseSettings, hears: Listeners) -> Base:
        port, spoken = settings.port, dialect(*settings.factors)
        if isinstance(spoken, KobukiDialect):
            spoken.allow_unknown_firmware = settings.allow_unknown_firmware
        return BaseDriver(
            spoken, lambda: SerialTransport(port, baud), port, hears.on_reading, hears.on_link,
            settings.command_timeout_s, hears.on_command,
        )  # fmt: skip

    return BaseEntry(driver, bases.stop_bytes(dialect), baud)


def _over_topics(settings: BaseSettings, hears: Listeners) -> Base:
    """Raises ConfigError for factors other than 1: all nodes hear the odometry from the base's own driver."""
    if settings.factors != (1.0, 1.0):
        raise ConfigError(
            f"robot.odometry has the factors {settings.linear_scale:g} and {settings.angular_scale:g}, but a base with "
            "a ROS driver of its own (base ros) is calibrated there: give them to that driver, and set both to 1 here"
        )
    names = topic_names(settings.robot_type) or TopicNames()
    return TopicBase(names, hears.on_reading, hears.on_link, settings.command_timeout_s)


BASES: Registry[BaseEntry] = Registry(
    "base",
    {name: at_port(kind.baud, kind.dialect) for name, kind in bases.BASES.items()} | {"ros": BaseEntry(_over_topics)},
    BaseEntry,
)


def _entry(robot_type: str) -> BaseEntry:
    """Raises ConfigError for an unknown kind, for words after the colon of one at a port, and for stop bytes that
    nobody could send for want of a baud rate."""
    kind, colon, _ = robot_type.partition(":")
    entry = BASES[kind]
    if colon and entry.stop is not None:
        raise ConfigError(f"~robot_type {robot_type!r}: give {kind}, and its port as ~port")
    if entry.stop is not None and entry.baud <= 0:
        raise ConfigError(f"the base {kind!r} has stop bytes and the baud rate {entry.baud}; give that of its port")
    return entry


def base_driver(settings: BaseSettings, hears: Listeners) -> Base:
    """The driver of a base; it connects when started. Raises ConfigError for a robot_type that does not exist."""
    return _entry(settings.robot_type).driver(settings, hears)


class NoWatchdogs(Watchdogs):
    """For a base without a serial port: there is nothing to take over."""

    def __init__(self) -> None:
        self._both = ()


def base_watchdogs(settings: BaseSettings) -> Watchdogs:
    """The processes that stop a base at a serial port if this process dies or hangs. All of them would sleep with
    the machine, so that is kept awake. Raises as ``base_driver`` does."""
    entry = _entry(settings.robot_type)
    if entry.stop is None:
        return NoWatchdogs()
    keep_awake(settings.port)
    return Watchdogs(settings.port, entry.baud, entry.stop)


def wired(robot_type: str) -> bases.BaseKind:
    """A base that has an emulator. Raises ConfigError for any other base."""
    if robot_type not in bases.BASES:
        raise ConfigError(f"~robot_type {robot_type!r} has no emulator: give {', '.join(bases.BASES)}")
    return bases.BASES[robot_type]


def base_settings(config: Config) -> BaseSettings:
    """The base (or auto) and its calibration. Raises ConfigError for a timeout or factor that is not above 0."""
    corrections = config.robot.odometry
    return BaseSettings(
        robot_type=str(rospy.get_param("~robot_type", "auto")),
        port=str(rospy.get_param("~port", "/dev/kobuki")),
        command_timeout_s=_positive("~cmd_vel_timeout", 0.25),
        linear_scale=_positive("~odom_linear_scale_correction", corrections.linear_scale),
        angular_scale=_positive("~odom_angular_scale_correction", corrections.angular_scale),
        allow_unknown_firmware=bool(rospy.get_param("~allow_unknown_firmware", False)),
    )


def wait_for_base(settings: BaseSettings, diagnostics: Diagnostics) -> BaseSettings:
    """For auto: wait until a base answers, and set its kind."""
    while settings.robot_type == "auto":
        if threads.is_ending():
            raise KeyboardInterrupt
        try:
            settings = settings._replace(robot_type=bases.detect_base(settings.port))
            rospy.loginfo("%s: found a %s", settings.port, settings.robot_type)
        except DeviceError as error:
            diagnostics.set("link", ERROR, str(error), device=settings.port)
            if logs.due("base", 10.0):
                rospy.logwarn("%s", error)
            time.sleep(1.0)
    return settings


def supervisor(config: Config, settings: BaseSettings) -> Supervisor:
    """With the emergency stop as the node stored it last."""
    timeout_s = settings.command_timeout_s
    sources = tuple(s._replace(timeout_s=timeout_s) if s.name == "navi" else s for s in SOURCES)
    made = Supervisor(speed_limits(config.limits), sources)
    made.emergency_stop(bool(rospy.get_param("~estopped", False)))
    return made


def speed_limits(limits: LimitsConfig) -> SpeedLimits:
    """Limits from ~max_vel and ~max_angular_vel; the defaults never slow down the follower. Raises ConfigError for a
    limit that is not above 0."""
    caps = []
    for name, default, wanted in (("~max_vel", 0.5, limits.v_m_s), ("~max_angular_vel", 1.5, limits.omega_rad_s)):
        caps.append(_positive(name, max(default, wanted)))
        if caps[-1] < wanted:
            rospy.logwarn(
                "%s is %g, less than the configured limit of %g: the base will lag behind its plans; lower the limit",
                rospy.resolve_name(name), caps[-1], wanted,
            )  # fmt: skip
    return SpeedLimits(*caps)


def _positive(name: str, default: float) -> float:
    """A parameter that must be a finite number above 0. Raises ConfigError for anything else."""
    told: Any = rospy.get_param(name, default)
    try:
        value = float(told)
    except (TypeError, ValueError):
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ConfigError(
            f"parameter {rospy.resolve_name(name)} is {told!r}; give a number above 0, or none for {default:g}"
        )
    return value
