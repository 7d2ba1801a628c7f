"""What the drivers report: values with units in their names, each with its timestamp.

``stamp_ns`` is host time (nanoseconds since the epoch), derived from the device's own clock where it has one."""

from __future__ import annotations

import enum
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # a process that stops wheels starts sooner without it
    import numpy as np
    from numpy.typing import NDArray

DRIFT_WINDOW_NS = 10_000_000_000  # in which two quartz clocks drift apart by at most a millisecond
RESTART_NS = 1_000_000_000  # no message is delayed so long
STEP_NS, UNINTERRUPTED_NS, TRIES = 1_000_000, 100_000, 10
"""Smallest step of the host's clock that is followed; longest time to read both of its clocks; tries to do so."""


class Hazard(enum.IntFlag):
    """Reasons not to move: contacts in the low byte, motors with overcurrent above it."""

    NONE = 0
    BUMPER_RIGHT = 1
    BUMPER_CENTER = 2
    BUMPER_LEFT = 4
    CLIFF_RIGHT = 8
    CLIFF_CENTER = 16
    CLIFF_LEFT = 32
    WHEEL_DROP_RIGHT = 64
    WHEEL_DROP_LEFT = 128
    OVERCURRENT_LEFT = 256
    OVERCURRENT_RIGHT = 512

    BUMPER = 7
    CLIFF = 56
    WHEEL_DROP = 192
    TOUCHED = 255
    OVERCURRENT = 768


class DockBeam(enum.IntFlag):
    """Infrared beams of a dock, named from the dock, which looks ahead. The bits are the Kobuki's; HALO surrounds an
    iRobot home base, whose red buoy shines to its left and whose green buoy to its right."""

    NONE = 0
    NEAR_LEFT = 1
    NEAR_CENTER = 2
    NEAR_RIGHT = 4
    CENTER = 8
    LEFT = 16
    RIGHT = 32
    HALO = 64


class DockSignals(NamedTuple):
    """The beams on each infrared receiver of a base, which look to its right, ahead and to its left. kind: of the base,
    as in ``bases.BASES``. A Create 1 has only one receiver, ``center``; on a Create it also sees to the sides."""

    kind: str
    right: DockBeam
    center: DockBeam
    left: DockBeam


class Signal(enum.Enum):
    """What a base shows to people: a green, an orange or a red lamp; an alarm also sounds when it begins."""

    READY = "ready"
    HELD = "held back"
    ALARM = "someone must act"


class OdometryReading(NamedTuple):
    """Dead reckoning since the last reset.

    x_m, y_m, heading_rad: pose of the base in its odometry frame, heading not wrapped, counter-clockwise.
    v_m_s, omega_rad_s: measured motion. gaps: how often motion was not measured (power cycle, lost data).
    trusted: False when the encoders cannot know the direction of the motion, or a sensor contradicts the others.
    wheels_m: (left, right) distance rolled since the start, without corrections.
    doubt: which sensor is not trusted, and why. fault: why the base must stand: its wheels do not follow their command.
    Both are words, empty while all is well."""

    stamp_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    v_m_s: float
    omega_rad_s: float
    gaps: int = 0
    trusted: bool = True
    wheels_m: tuple[float, float] = (0.0, 0.0)
    doubt: str = ""
    fault: str = ""


class RateSample(NamedTuple):
    """One sample of a three-axis gyro [rad/s], in the axes of the base: x ahead, y left, z up."""

    stamp_ns: int
    x: float
    y: float
    z: float


class GyroReading(NamedTuple):
    """Heading since the gyro was switched on and its rate, counter-clockwise; the heading may wrap at +-pi.

    trusted: False while the wheels contradict it. raw: samples since the last report, newest last, not filtered, zero
    not subtracted."""

    heading_rad: float
    rate_rad_s: float
    trusted: bool = True
    raw: tuple[RateSample, ...] = ()


class BatteryReading(NamedTuple):
    """State of the base's battery. fraction: in [0, 1]. charging: a charger delivers current. docked: the base stands
    at its dock. current_a: into the battery, negative: out of it; None: not measured."""

    voltage_v: float
    fraction: float
    charging: bool
    state: str
    docked: bool = False
    current_a: float | None = None


class BaseReading(NamedTuple):
    """One report of a base: where it is, what it touches, how much energy is left.

    mode names the operating mode where the base has several; buttons is the protocol's bit mask; gyro is None for a
    base without one, or before its zero is known. refusal: why this base must not be driven as it is, with the remedy.
    warnings: reported values that the driver does not know. dock: None for a base without receivers. disobeys: why it
    ignores the present commands, with the remedy; it is told them on, as it may obey again."""

    stamp_ns: int
    odometry: OdometryReading
    hazards: Hazard
    battery: BatteryReading
    buttons: int = 0
    mode: str = ""
    gyro: GyroReading | None = None
    refusal: str = ""
    warnings: tuple[str, ...] = ()
    dock: DockSignals | None = None
    disobeys: str = ""


class ImageReading(NamedTuple):
    """One complete image, (H, W) uint8, rows from the top. stamp_ns: host time at which the first row left the camera.
    encoding: the ROS name, bayer_grbg8 (first row G R G R) or mono8."""

    stamp_ns: int
    image: NDArray[np.uint8]
    encoding: str = "bayer_grbg8"


class LinkStatus(NamedTuple):
    """Health of the connection to a device, for diagnostics. Counters run from the start of the driver. alive: False
    when the driver has ended unexpectedly, for good."""

    connected: bool
    message: str
    device: str
    counters: dict[str, int]
    alive: bool = True


def host_ahead_ns() -> int:
    """By how much the host's time since the epoch is ahead of its monotonic time; a step of the clock changes it."""
    return ahead_of_monotonic_ns(time.time_ns)


def ahead_of_monotonic_ns(clock_ns: Callable[[], int]) -> int:
    """By how much a clock is ahead of the host's monotonic time. Read again when the process was interrupted."""
    spans = []
    for _ in range(TRIES):
        begin_ns, told_ns, end_ns = time.monotonic_ns(), clock_ns(), time.monotonic_ns()
        spans.append((end_ns - begin_ns, told_ns - begin_ns))
        if spans[-1][0] < UNINTERRUPTED_NS:
            break
    return min(spans)[1]


class DeviceClock:
    """Unwraps a counter of tick_hz that wraps at 2**bits, and converts it to host time.

    A device stamps evenly; the messages arrive late by a varying amount (USB scheduling, a busy machine). The smallest
    difference (arrival - device time) of the last seconds is the best estimate of the clocks' offset. Windows follow
    the drift between the two crystals. The estimate uses the host's monotonic time, which is never set; ahead_ns tells
    by how much the time since the epoch is ahead of it."""

    def __init__(self, tick_hz: int, bits: int, ahead_ns: Callable[[], int] | None = None) -> None:
        self._read_ahead_ns = ahead_ns or host_ahead_ns
        self._ahead_ns = self._ahead_before_ns = self._read_ahead_ns()
        self._stepped_ns = -RESTART_NS
        self._tick_hz = tick_hz
        self._modulus = 1 << bits
        self._raw: int | None = None
        self._ticks = self._arrival_ns = self._window_start_ns = self._last_ns = 0
        self._least_ns: deque[int] = deque(maxlen=2)  # offset in this window and in the one before

    def host_ns(self, raw: int, arrival_ns: int) -> int:
        """Host time of the counter value raw that arrived at arrival_ns; strictly increasing between restarts.

        A jump against the host's clock of more than a second (the device restarted, or was silent for long) restarts
        the estimate. After a step of the host's clock the stamps are those of the new time at once."""
        ticks = 0 if self._raw is None else (raw - self._raw) % self._modulus
        arrival_ns = self._monotonic_ns(arrival_ns, self._arrival_ns + self._ns(ticks))
        jump_ns = arrival_ns - self._arrival_ns - self._ns(ticks)
        if self._raw is None or abs(jump_ns) > RESTART_NS:
            self._least_ns.clear()
            self._ticks, self._last_ns = raw, 0
        else:
            self._ticks += ticks
        self._raw, self._arrival_ns = raw, arrival_ns
        offset_ns = arrival_ns - self._ns(self._ticks)
        if not self._least_ns or arrival_ns - self._window_start_ns > DRIFT_WINDOW_NS:
            self._least_ns.append(offset_ns)
            self._window_start_ns = arrival_ns
        else:
            self._least_ns[-1] = min(self._least_ns[-1], offset_ns)
        stamp_ns = self._ns(self._ticks) + min(self._least_ns) + self._ahead_ns
        self._last_ns = max(self._last_ns + 1, stamp_ns)
        return self._last_ns

    def _monotonic_ns(self, arrival_ns: int, expected_ns: int) -> int:
        """The arrival in the host's monotonic time; for a second after a step it may be an arrival before it."""
        ahead_ns = self._read_ahead_ns()
        if abs(ahead_ns - self._ahead_ns) > STEP_NS:
            self._ahead_before_ns, self._ahead_ns = self._ahead_ns, ahead_ns
            self._stepped_ns, self._last_ns = arrival_ns - ahead_ns, 0
        now_ns, before_ns = arrival_ns - self._ahead_ns, arrival_ns - self._ahead_before_ns
        if now_ns - self._stepped_ns > RESTART_NS or abs(now_ns - expected_ns) <= abs(before_ns - expected_ns):
            return now_ns
        return before_ns

    def _ns(self, ticks: int) -> int:
        return ticks * 1_000_000_000 // self._tick_hz
