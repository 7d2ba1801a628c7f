"""The protocol of the Kobuki for ``BaseDriver``."""

from collections.abc import Iterable

from vsx_hw.base_driver import Dialect
from vsx_hw.kobuki import protocol
from vsx_hw.kobuki.feedback import CHARGER_STATES, STEADY_GYRO, Core, Feedback, Version, battery_of, objection
from vsx_hw.kobuki.odometry import KobukiOdometry, gyro_reading
from vsx_hw.kobuki.protocol import BaseControl, Led, encode_frame
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.readings import BaseReading, DeviceClock, DockBeam, DockSignals, Hazard, Signal
from vsx_hw.wheel_commands import TurnErrorFeedback, within_limit

_LAMPS = {Signal.READY: Led.GREEN, Signal.HELD: Led.ORANGE, Signal.ALARM: Led.RED}
_STILL = protocol.drive_payload(BaseControl(0, 0))

VERSION_REQUESTS = 10  # then its firmware stays unknown
FRAMES_PER_REQUEST = 25  # commands between two requests: half a second
WIRE_NS = 7_000_000
"""A regular frame of 81 bytes takes 7 ms at 115200 baud: the measurement is older than its last byte."""


class KobukiDialect(Dialect):
    """Converts Kobuki frames to readings, and commands to frames. Readings hold a refusal until the base has reported a
    known firmware; ``allow_unknown_firmware`` turns the refusal into a warning."""

    def __init__(self, linear_scale: float = 1.0, angular_scale: float = 1.0) -> None:
        self.allow_unknown_firmware = False
        self.odometry = KobukiOdometry(linear_scale, angular_scale)
        self._parser = StreamParser()
        self._start_connection()

    def _start_connection(self) -> None:
        self._parser.restart()
        self._clock = DeviceClock(1000, 16)
        self._commands_sent = 0
        self.firmware: Version | bytes | None = None
        self._hardware: Version | bytes | None = None
        self._hazards = Hazard.NONE
        self._rounding = TurnErrorFeedback()

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """Supplies on (the camera's 12 V), wheels still."""
        self._start_connection()
        return [(encode_frame(protocol.outputs_payload(), _STILL), 0.0)]

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """See Dialect."""
        return [self._reading(feedback, now_ns) for feedback in self._parser.feed(data, now_ns)]

    def _reading(self, feedback: Feedback, now_ns: int) -> BaseReading:
        core = feedback.core
        self.firmware = feedback.firmware_version or self.firmware
        self._hardware = feedback.hardware_version or self._hardware
        refusal, warnings = self._trust(core)
        hazards = hazards_of(core)  # a contact ends with the second frame without it: one frame may be damaged
        held, self._hazards = hazards | self._hazards, hazards
        stamp_ns = self._clock.host_ns(core.time_ms, now_ns) - WIRE_NS
        odometry = self.odometry.update(feedback, stamp_ns)
        battery = battery_of(core.battery_decivolt, core.charger)
        gyro = gyro_reading(feedback, stamp_ns, self.odometry.gyro_trusted)
        return BaseReading(
            stamp_ns, odometry, held, battery, buttons=core.buttons, gyro=gyro, refusal=refusal, warnings=warnings,
            dock=None if feedback.dock_ir is None else DockSignals("kobuki", *map(DockBeam, feedback.dock_ir)),
        )  # fmt: skip

    def _trust(self, core: Core) -> tuple[str, tuple[str, ...]]:
        """(refusal, warnings) from the versions and this frame."""
        warnings = []
        refusal = objection(self.firmware, self._hardware)
        if refusal and self.allow_unknown_firmware:
            warnings.append(f"{refusal.split(';')[0]}; allowed by ~allow_unknown_firmware")
            refusal = ""
        if isinstance(self.firmware, Version) and self.firmware < STEADY_GYRO:
            warnings.append(f"firmware {self.firmware}: the gyro drifts; flash 1.2.0")
        if core.charger not in CHARGER_STATES:
            warnings.append(f"charger state {core.charger} is unknown, taken for not charging; look at the charger")
        return refusal, tuple(warnings)

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """Base control. Also requests the versions until known ones are reported, at most VERSION_REQUESTS times."""
        v_m_s, omega_rad_s = within_limit(v_m_s, omega_rad_s, protocol.WHEEL_BASE_M, protocol.SPEED_LIMIT_M_S)
        self.odometry.command(v_m_s, omega_rad_s)
        payloads = [protocol.drive_payload(self._rounding.command(v_m_s, omega_rad_s, _encoded))]
        requests, remainder = divmod(self._commands_sent, FRAMES_PER_REQUEST)
        if objection(self.firmware, self._hardware) and remainder == 0 and requests < VERSION_REQUESTS:
            payloads.append(protocol.request_versions_payload())
        self._commands_sent += 1
        return encode_frame(*payloads)

    def halt(self) -> bytes:
        """See Dialect."""
        return encode_frame(_STILL)

    def show(self, signal: Signal) -> bytes:
        """See Dialect. Uses the first lamp."""
        sound = [protocol.melody_payload(protocol.ERROR_MELODY)] if signal is Signal.ALARM else []
        return encode_frame(protocol.outputs_payload(led1=_LAMPS[signal]), *sound)

    def farewell(self) -> bytes:
        """Stand still; the supplies stay on."""
        return encode_frame(_STILL, protocol.outputs_payload())

    def counters(self) -> dict[str, int]:
        """See Dialect."""
        return {
            "frames": self._parser.frames,
            "refused_frames": self._parser.refused,
            "skipped_bytes": self._parser.skipped_bytes,
        }

    def silence(self) -> str:
        """See Dialect."""
        if self._parser.doubts:
            return "no report can follow the one before: the base's clock or counters fail; switch it off and on"
        return (
            f"switch the Kobuki on and check ~robot_type: a Kobuki speaks unasked at {protocol.BAUD} baud; a Create 1 "
            "answers at 57600, a Create 2 or Roomba at 115200; 'auto' finds out"
        )


def hazards_of(core: Core) -> Hazard:
    """The level of each contact in this frame (not its edges: a missed edge would leave the robot blind)."""
    return Hazard(core.bumper | core.cliff << 3 | core.wheel_drop << 6 | core.overcurrent << 8)


def _encoded(v_m_s: float, omega_rad_s: float) -> tuple[BaseControl, float]:
    command = protocol.base_control(v_m_s, omega_rad_s)
    return command, protocol.twist_of(command)[1]
