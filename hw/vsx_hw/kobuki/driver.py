"""The language of the Kobuki."""

from __future__ import annotations

from collections.abc import Iterable

from vsx_hw.clock import DeviceClock
from vsx_hw.kobuki.base_control import BaseControl, base_control
from vsx_hw.kobuki.framing import encode_frame
from vsx_hw.kobuki.gyro import gyro_reading
from vsx_hw.kobuki.odometry import KobukiOdometry
from vsx_hw.kobuki.protocol import (
    AT_THE_DOCK,
    BAUD,
    Core,
    Feedback,
    Led,
    Sound,
    StreamParser,
    battery_state,
    drive_payload,
    melody_payload,
    outputs_payload,
    request_versions_payload,
)
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, Signal

_LAMPS = {Signal.READY: Led.GREEN, Signal.HELD: Led.ORANGE, Signal.ALARM: Led.RED}

VERSION_REQUESTS = 10
FRAMES_PER_REQUEST = 25
WIRE_NS = 7_000_000
"""A regular frame of 81 bytes takes 7 ms at 115200 baud: it was measured before its last byte arrived."""


class KobukiDialect:
    """Kobuki frames as readings of a base, commands as frames; see ``vsx_hw.base_driver.Dialect``."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        self.firmware: tuple[int, int, int] | None = None
        self._odometry = KobukiOdometry(linear_scale, angular_scale)
        self._frames = self._refused = self._skipped = 0
        self._start_connection()

    def _start_connection(self) -> None:
        self._parser = StreamParser()
        self._clock = DeviceClock(1000, 16)
        self._commands_sent = 0

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """Supplies on (the camera's 12 V), wheels still."""
        self._keep_counters()
        self._start_connection()
        return [(encode_frame(outputs_payload(), drive_payload(BaseControl(0, 0))), 0.0)]

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect."""
        return [self._reading(feedback, now_ns) for feedback in self._parser.feed(data)]

    def _reading(self, feedback: Feedback, now_ns: int) -> BaseReading:
        core = feedback.core
        self.firmware = feedback.firmware_version or self.firmware
        stamp_ns = self._clock.host_ns(core.time_ms, now_ns) - WIRE_NS
        fraction, state, charging = battery_state(core.battery_decivolt, core.charger)
        odometry = self._odometry.update(feedback, stamp_ns)
        return BaseReading(
            stamp_ns,
            odometry,
            hazards_of(core),
            BatteryReading(core.battery_decivolt / 10.0, fraction, charging, state, core.charger in AT_THE_DOCK),
            core.buttons,
            gyro=gyro_reading(feedback, stamp_ns, self._odometry.gyro_trusted),
        )

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """Base control; until the base has told its versions they are asked for now and then, but not for ever."""
        self._odometry.command(v_m_s, omega_rad_s)
        payloads = [drive_payload(base_control(v_m_s, omega_rad_s))]
        requests, remainder = divmod(self._commands_sent, FRAMES_PER_REQUEST)
        if self.firmware is None and remainder == 0 and requests < VERSION_REQUESTS:
            payloads.append(request_versions_payload())
        self._commands_sent += 1
        return encode_frame(*payloads)

    def halt(self) -> bytes:
        """See Dialect."""
        return encode_frame(drive_payload(BaseControl(0, 0)))

    def show(self, signal: Signal) -> bytes:
        """See Dialect. The first lamp."""
        sound = [melody_payload(Sound.ERROR)] if signal is Signal.ALARM else []
        return encode_frame(outputs_payload(led1=_LAMPS[signal]), *sound)

    def farewell(self) -> bytes:
        """Stand still; the supplies stay on."""
        return encode_frame(drive_payload(BaseControl(0, 0)), outputs_payload())

    def reset_odometry(self) -> None:
        """See Dialect."""
        self._odometry.reset()

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {
            "frames": self._frames + self._parser.frames,
            "refused_frames": self._refused + self._parser.refused,
            "skipped_bytes": self._skipped + self._parser.skipped_bytes,
        }

    def silence(self) -> str:
        """See Dialect."""
        return (
            f"switch the Kobuki on and check ~robot_type: a Kobuki speaks unasked at {BAUD} baud; a Create 1 answers "
            "at 57600, a Create 2 or Roomba at 115200; 'auto' finds out"
        )

    def _keep_counters(self) -> None:
        self._frames += self._parser.frames
        self._refused += self._parser.refused
        self._skipped += self._parser.skipped_bytes


def hazards_of(core: Core) -> Hazard:
    """The level of each contact in this frame (not its edges: a missed edge would leave the robot blind)."""
    return Hazard(core.bumper | core.cliff << 3 | core.wheel_drop << 6)
