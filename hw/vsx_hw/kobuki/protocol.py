"""Kobuki serial protocol: bytes to values and back, no I/O.

Source: Yujin Robot, Kobuki "Serial Protocol" appendix. A frame is ``AA 55 LEN payload XOR``; the payload is a row of
sub-payloads ``ID LEN data``, little endian. The XOR of everything from LEN to the checksum is 0. 115200 baud, 8N1.
"""

import enum
import math
import struct
from typing import Any, NamedTuple

from vsx_hw.errors import ProtocolError
from vsx_hw.kobuki.base_control import BaseControl
from vsx_hw.kobuki.framing import sub_payloads
from vsx_hw.kobuki.versions import Version, decode_version

BAUD = 115200
METRES_PER_TICK = 0.000085292090497737557
GYRO_STEP_RAD = math.radians(0.01)
CHARGER_STATES = {0: "", 2: "charged", 6: "charging", 18: "charged", 22: "charging"}
AT_THE_DOCK = (2, 6)
"""Charger bytes: discharging, then charged and charging at the dock; those of the adapter have bit 16 set."""
PART_BYTES = {
    1: (15,), 3: (3,), 4: (7,), 5: (6,), 6: (2,), 10: (2, 4), 11: (2, 4), 15: (17,), 16: (16,), 19: (12,), 21: (13,),
}  # fmt: skip
"""Sub-payload -> its lengths; that of 13, the gyro, is in its own second byte."""
ANSWERS = {10, 11, 15, 19, 21}
"""Sub-payloads that come when asked for."""
BATTERY_EMPTY_V, BATTERY_LOW_V, BATTERY_FULL_V = 13.2, 14.0, 16.5


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


class GeneralInput(NamedTuple):
    """Sub-payload 16: digital inputs 0-3 as bits, four 12-bit voltages of 3.3 V full scale."""

    digital: int
    analog: tuple[int, int, int, int]


class ControllerInfo(NamedTuple):
    """Sub-payload 21: wheel controller gains, times 1000."""

    kind: int
    p: int
    i: int
    d: int


class Feedback(NamedTuple):
    """One verified frame; parts that the frame did not carry are None.

    dock_ir, cliff_adc: right, centre, left. current: left, right [10 mA].
    regular_parts: ids of what each frame of a base carries, without the answers to questions.
    """

    core: Core
    inertia: Inertia | None = None
    dock_ir: tuple[int, int, int] | None = None
    cliff_adc: tuple[int, int, int] | None = None
    current: tuple[int, int] | None = None
    gyro: RawGyro | None = None
    general_input: GeneralInput | None = None
    hardware_version: Version | None = None
    firmware_version: Version | None = None
    udid: tuple[int, int, int] | None = None
    controller: ControllerInfo | None = None
    regular_parts: frozenset[int] = frozenset()


def decode(payload: bytes) -> Feedback | None:
    """The frame, or None unless its parts tile it, each once and as long as documented, with values in their ranges.
    Parts with unknown ids are skipped."""
    parts = sub_payloads(payload) or []
    fields = dict(parts)
    core = _core(fields.get(1, b""))
    if core is None or len(fields) != len(parts) or not all(_is_whole(*part) for part in parts):
        return None
    inertia, gyro, inputs = fields.get(4), fields.get(13), _exact("<8H", fields.get(16))
    feedback = Feedback(
        core,
        Inertia(*struct.unpack_from("<hh", inertia)) if inertia else None,
        dock_ir=_exact("<3B", fields.get(3)),
        cliff_adc=_exact("<3H", fields.get(5)),
        current=_exact("<2B", fields.get(6)),
        gyro=RawGyro(gyro[0], tuple(struct.iter_unpack("<hhh", gyro[2:]))) if gyro else None,
        general_input=GeneralInput(inputs[0], inputs[1:5]) if inputs else None,
        hardware_version=decode_version(fields.get(10)),
        firmware_version=decode_version(fields.get(11)),
        udid=_exact("<3I", fields.get(19)),
        controller=ControllerInfo(*values) if (values := _exact("<B3I", fields.get(21))) else None,
        regular_parts=frozenset(fields.keys() - ANSWERS),
    )
    volts = (*(feedback.cliff_adc or ()), *(feedback.general_input.analog if feedback.general_input else ()))
    return feedback if max(volts, default=0) < 4096 and max(feedback.dock_ir or (0,)) < 64 else None


def _is_whole(kind: int, data: bytes) -> bool:
    if kind == 13:
        return len(data) > 2 and data[1] % 3 == 0 and len(data) == 2 + 2 * data[1]
    return len(data) in PART_BYTES.get(kind, (len(data),))


def _exact(layout: str, data: bytes | None) -> Any:
    """The fields of data, or None where it is absent."""
    return None if data is None else struct.unpack(layout, data)


def _core(data: bytes) -> Core | None:
    if len(data) != 15:
        return None
    core = Core(*struct.unpack("<HBBBHHbbBBBB", data))
    flags_are_known = max(core.bumper, core.cliff, core.buttons) <= 7 and max(core.wheel_drop, core.overcurrent) <= 3
    return core if flags_are_known else None


def battery_state(decivolt: int, charger: int) -> tuple[float, str, bool]:
    """(fraction, state in a word, charging) of the core's battery byte and charger byte. Thresholds of the vendor's
    diagnostics: healthy above 14.0 V, low above 13.2 V; 5 % at 13.2 V, 100 % at 16.5 V."""
    volt = decivolt / 10.0
    fraction = 0.05 + 0.95 * (volt - BATTERY_EMPTY_V) / (BATTERY_FULL_V - BATTERY_EMPTY_V)
    state = CHARGER_STATES.get(charger, "")
    if not state:
        state = "healthy" if volt > BATTERY_LOW_V else "low" if volt > BATTERY_EMPTY_V else "critical"
    return min(1.0, max(0.0, fraction)), state, state == "charging"


class Led(enum.IntEnum):
    """Colour of one of the two lamps."""

    OFF = 0
    RED = 1
    GREEN = 2
    ORANGE = 3


class Sound(enum.IntEnum):
    """Melodies of the base."""

    ON = 0
    OFF = 1
    RECHARGE = 2
    BUTTON = 3
    ERROR = 4
    CLEANING_START = 5
    CLEANING_END = 6


def drive_payload(command: BaseControl) -> bytes:
    """Sub-payload 1."""
    return struct.pack("<BBhh", 1, 4, command.speed_mm_s, command.radius_mm)


def sound_payload(frequency_hz: float, duration_ms: int) -> bytes:
    """Sub-payload 3: one note. Raises ProtocolError for a note or duration the base cannot play."""
    note = round(1.0 / (frequency_hz * 0.00000275)) if frequency_hz > 0 else 0
    if not (1 <= note <= 0xFFFF and 0 <= duration_ms <= 255):
        raise ProtocolError(f"sound: {frequency_hz} Hz for {duration_ms} ms; use 6 Hz-360 kHz and at most 255 ms")
    return struct.pack("<BBHB", 3, 3, note, duration_ms)


def melody_payload(sound: Sound) -> bytes:
    """Sub-payload 4."""
    return bytes((4, 1, sound))


def outputs_payload(led1: Led = Led.OFF, led2: Led = Led.OFF, digital: int = 0) -> bytes:
    """Sub-payload 12. Lamps, digital outputs 0-3 and the external supplies share one register, so the supplies' bits
    0x00F0 are always set: clearing them with a lamp command would cut the camera's 12 V."""
    if not 0 <= digital <= 0x0F:
        raise ProtocolError(f"digital outputs: {digital} is not a mask of the four outputs")
    return struct.pack("<BBH", 12, 2, digital | 0x00F0 | led1 << 8 | led2 << 10)


def request_versions_payload() -> bytes:
    """Sub-payload 9: hardware version, firmware version and UDID, once."""
    return bytes((9, 2, 0x0B, 0))


def get_gains_payload() -> bytes:
    """Sub-payload 14."""
    return bytes((14, 1, 0))


def factory_gains_payload() -> bytes:
    """Sub-payload 13 with the documented defaults P 100, I 0.1, D 2."""
    return struct.pack("<BBBIII", 13, 13, 0, 100_000, 100, 2_000)
