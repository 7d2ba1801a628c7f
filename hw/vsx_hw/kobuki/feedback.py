"""Decodes the frames of a Kobuki, and lists the versions that this driver knows.

Sources: Yujin Robot, Kobuki "Serial Protocol" appendix; kobuki_core, packets firmware and hardware (two bytes); iClebo
Kobuki user guide, "Firmware, Version Checking" (a major version breaks the protocol), and the firmware's changelog
(1.1.4 fixes the drift of the gyro)."""

import math
import struct
from typing import Any, NamedTuple

from vsx_hw.kobuki.protocol import sub_payloads
from vsx_hw.readings import BatteryReading

METRES_PER_TICK = 0.000085292090497737557  # of a wheel, as the maker gives it
GYRO_STEP_RAD = math.radians(0.01)  # hundredths of a degree
CHARGER_STATES = {0: "", 2: "charged", 6: "charging", 18: "charged", 22: "charging"}  # protocol's byte
AT_THE_DOCK = (2, 6)
"""Charger bytes for charged and charging at the dock; those of the adapter also have bit 16 set; 0 is discharging."""
PART_BYTES = {
    1: (15,), 3: (3,), 4: (7,), 5: (6,), 6: (2,), 10: (2, 4), 11: (2, 4), 15: (17,), 16: (16,), 19: (12,), 21: (13,),
}  # fmt: skip
"""Sub-payload -> its lengths; 13, the gyro, gives its length in its own second byte."""
ANSWERS = {10, 11, 15, 19, 21}  # Sub-payloads that are sent on request
BATTERY_EMPTY_V, BATTERY_LOW_V, BATTERY_FULL_V = 13.2, 14.0, 16.5  # of four lithium-ion cells


class Version(NamedTuple):
    """Major, minor and patch; the major version of the firmware is that of the protocol."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        """major.minor.patch."""
        return f"{self.major}.{self.minor}.{self.patch}"


PROTOCOL = 1  # major version
KNOWN_FIRMWARE = {Version(1, *rest) for rest in ((0, 0), (1, 0), (1, 1), (1, 2), (1, 3), (1, 4), (2, 0))}
STEADY_GYRO = Version(1, 1, 4)  # from here on the gyro's heading can be trusted
# Firmware before 1.1.2 tells each version as one number.
FIRMWARE_NUMBERS = {
    123: Version(1, 0, 0),
    **dict.fromkeys((110, 10100), Version(1, 1, 0)),
    **dict.fromkeys((111, 10101), Version(1, 1, 1)),
}
HARDWARE_NUMBERS = {104: Version(1, 0, 4)}


class Core(NamedTuple):
    """Sub-payload 1, in every frame. Bits: bumper and cliff 1 right, 2 centre, 4 left; wheel_drop 1 right, 2 left;
    overcurrent 1 left, 2 right. Encoders and time are 16-bit counters that wrap."""

    time_ms: int
    bumper: int
    wheel_drop: int
    cliff: int
    left_ticks: int
    right_ticks: int
    left_pwm: int
    right_pwm: int
    buttons: int
    charger: int
    battery_decivolt: int
    overcurrent: int


class Inertia(NamedTuple):
    """Sub-payload 4: heading by the gyro and its rate, in hundredths of a degree, counter-clockwise."""

    angle_centideg: int
    rate_centideg_s: int


class RawGyro(NamedTuple):
    """Sub-payload 13: two or three samples (x, y, z) of 0.00875 deg/s, 10 ms apart, in the sensor's axes."""

    frame_id: int
    samples: tuple[tuple[int, int, int], ...]


class ControllerInfo(NamedTuple):
    """Sub-payload 21: wheel controller gains, times 1000."""

    kind: int
    p: int
    i: int
    d: int


class Feedback(NamedTuple):
    """One verified frame; parts that the frame did not carry are None.

    dock_ir, cliff_adc: right, centre, left. current: left, right [10 mA]. analog: inputs 0-3, 12 bits of 3.3 V.
    hardware_version, firmware_version: bytes where they are no version that is documented. regular_parts: ids of the
    parts that every frame of a base carries, without answers to requests."""

    core: Core
    inertia: Inertia | None = None
    dock_ir: tuple[int, int, int] | None = None
    cliff_adc: tuple[int, int, int] | None = None
    current: tuple[int, int] | None = None
    gyro: RawGyro | None = None
    analog: tuple[int, int, int, int] | None = None
    hardware_version: Version | bytes | None = None
    firmware_version: Version | bytes | None = None
    udid: tuple[int, int, int] | None = None
    controller: ControllerInfo | None = None
    regular_parts: frozenset[int] = frozenset()


def decode(payload: bytes) -> Feedback | None:
    """Decode a frame. None unless its parts fill it exactly, each once, with documented lengths and values in their
    ranges. Parts with unknown ids are skipped."""
    parts = sub_payloads(payload) or []
    fields = dict(parts)
    if 1 not in fields or len(fields) != len(parts) or not all(_is_whole(*part) for part in parts):
        return None
    gyro, gains = fields.get(13), _exact("<B3I", fields.get(21))
    feedback = Feedback(
        Core(*_exact("<HBBBHHbbBBBB", fields[1])),
        Inertia(*struct.unpack_from("<hh", fields[4])) if 4 in fields else None,
        dock_ir=_exact("<3B", fields.get(3)),
        cliff_adc=_exact("<3H", fields.get(5)),
        current=_exact("<2B", fields.get(6)),
        gyro=RawGyro(gyro[0], tuple(struct.iter_unpack("<hhh", gyro[2:]))) if gyro else None,
        analog=_exact("<2x4H6x", fields.get(16)),
        hardware_version=decode_version(fields.get(10), HARDWARE_NUMBERS),
        firmware_version=decode_version(fields.get(11), FIRMWARE_NUMBERS),
        udid=_exact("<3I", fields.get(19)),
        controller=ControllerInfo(*gains) if gains else None,
        regular_parts=frozenset(fields.keys() - ANSWERS),
    )
    return feedback if _is_in_range(feedback) else None


def _is_whole(kind: int, data: bytes) -> bool:
    if kind == 13:
        return len(data) > 2 and data[1] % 3 == 0 and len(data) == 2 + 2 * data[1]
    return len(data) in PART_BYTES.get(kind, (len(data),))


def _exact(layout: str, data: bytes | None) -> Any:
    """The fields of data, or None where it is absent."""
    return None if data is None else struct.unpack(layout, data)


def _is_in_range(feedback: Feedback) -> bool:
    core, volts = feedback.core, (*(feedback.cliff_adc or ()), *(feedback.analog or ()))
    known = max(core.bumper, core.cliff, core.buttons) <= 7 and max(core.wheel_drop, core.overcurrent) <= 3
    return known and max(volts, default=0) < 4096 and max(feedback.dock_ir or (0,)) < 64


def battery_of(decivolt: int, charger: int) -> BatteryReading:
    """The core's battery byte and charger byte. Thresholds of the vendor's diagnostics: healthy above 14.0 V, low above
    13.2 V; 5 % at 13.2 V, 100 % at 16.5 V."""
    volt = decivolt / 10.0
    fraction = 0.05 + 0.95 * (volt - BATTERY_EMPTY_V) / (BATTERY_FULL_V - BATTERY_EMPTY_V)
    level = "healthy" if volt > BATTERY_LOW_V else "low" if volt > BATTERY_EMPTY_V else "critical"
    state = CHARGER_STATES.get(charger) or level
    charging, docked = state == "charging", charger in AT_THE_DOCK
    return BatteryReading(volt, min(1.0, max(0.0, fraction)), charging=charging, state=state, docked=docked)


def decode_version(data: bytes | None, numbers: dict[int, Version]) -> Version | bytes | None:
    """Four bytes patch, minor, major, 0, or a number of two bytes that is in ``numbers``; any others as they are."""
    if data is None:
        return None
    if len(data) == 4 and data[3] == 0:
        return Version(data[2], data[1], data[0])
    return numbers.get(int.from_bytes(data, "little"), data) if len(data) == 2 else data


def _undefined(data: bytes) -> str:
    told = f"number {int.from_bytes(data, 'little')}" if len(data) == 2 else f"bytes {data.hex(' ')}"
    return f"of the {told} is unknown"


def objection(firmware: Version | bytes | None, hardware: Version | bytes | None) -> str:
    """Why a Kobuki of these versions must not be driven, with the remedy; empty for known versions."""
    remedy = (
        f"this driver knows {', '.join(map(str, sorted(KNOWN_FIRMWARE)))}: flash 1.2.0, "
        "or set ~allow_unknown_firmware to drive it all the same"
    )
    if firmware is None:
        return f"the Kobuki has not told its firmware version; {remedy}"
    if isinstance(firmware, bytes):
        return f"firmware {_undefined(firmware)}; {remedy}"
    if firmware.major != PROTOCOL:
        return f"firmware {firmware} speaks protocol {firmware.major}, not {PROTOCOL}; {remedy}"
    if firmware not in KNOWN_FIRMWARE:
        return f"firmware {firmware} is unknown; {remedy}"
    allow = "set ~allow_unknown_firmware to drive it all the same"
    if hardware is None:
        return f"the Kobuki has not told its hardware version; switch it off and on, or {allow}"
    if isinstance(hardware, bytes):
        return f"hardware {_undefined(hardware)}; {allow}"
    if hardware.major != PROTOCOL:
        return f"hardware {hardware} is unknown, Kobukis are 1.x; {allow}"
    return ""
