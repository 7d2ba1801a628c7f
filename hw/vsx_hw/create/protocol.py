"""iRobot Open Interface of the Create 1 and of the Create 2 (Roomba 600): bytes to values and back, no I/O.

Source: iRobot, "Create Open Interface" and "Create 2 Open Interface Specification". Big endian throughout."""

import enum
import math
import struct
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from vsx_hw.errors import ProtocolError

SPEED_LIMIT_MM_S = 500  # of a wheel (Open Interface)
STREAM_HEADER = 19  # first byte of a stream's frames (Open Interface)
STREAM_PERIOD_NS = 15_000_000  # of a stream (Open Interface)


class Opcode(enum.IntEnum):
    """The first byte of a command."""

    START = 128
    SAFE = 131
    FULL = 132
    DRIVE = 137
    LAMPS = 139
    SONG = 140
    PLAY = 141
    DRIVE_DIRECT = 145
    DIGITAL_OUTPUTS = 147
    STREAM = 148
    QUERY_LIST = 149
    PAUSE_STREAM = 150
    STOP = 173


class Mode(enum.IntEnum):
    """Packet 35. Real robots also report 4 and 32: UNKNOWN; it is not known whether they then obey."""

    UNKNOWN = -1
    OFF = 0
    PASSIVE = 1
    SAFE = 2
    FULL = 3


class Model(NamedTuple):
    """What differs between the two robots; lengths in metres."""

    name: str
    baud: int
    wheel_base_m: float
    wheel_diameter_m: float


CREATE_1 = Model("create", 57600, 0.258, 0.078)  # baud; wheel base and diameter of wheels, m
CREATE_2 = Model("create2", 115200, 0.235, 0.072)  # as above
TICKS_PER_REVOLUTION = 508.8  # of the encoders (Create 2 Open Interface)
METRES_PER_TICK = math.pi * CREATE_2.wheel_diameter_m / TICKS_PER_REVOLUTION

LAYOUT: dict[int, str] = {
    **dict.fromkeys((*range(7, 19), 21, 32, 34, 35, 36, 37, 38, 45, 52, 53, 58), "B"),
    **dict.fromkeys((22, 25, 26, 27, 28, 29, 30, 31, 33, 43, 44, 46, 47, 48, 49, 50, 51), "H"),
    **dict.fromkeys((19, 20, 23, 39, 40, 41, 42, 54, 55, 56, 57), "h"),
    24: "b",
}
"""Packet id -> letter of struct, big endian. 7 bumps and wheel drops, 9-12 cliffs, 18 buttons, 19 distance [mm],
20 angle [deg], 21 charging state, 22 voltage [mV], 23 current [mA], 25 charge and 26 capacity [mAh], 34 chargers,
35 mode, 43 and 44 encoders; 17, 52, 53 infrared characters from all sides, left, right."""

GROUPS: dict[int, range] = {
    0: range(7, 27), 1: range(7, 17), 2: range(17, 21), 3: range(21, 27), 4: range(27, 35), 5: range(35, 43),
    6: range(7, 43), 100: range(7, 59), 101: range(43, 59), 106: range(46, 52), 107: range(54, 59),
}  # fmt: skip
"""Packet ids that stand for several packets in a row."""


def _layout(packets: Iterable[int]) -> str:
    return ">" + "".join(LAYOUT[packet] for packet in packets)


def single_packets(packets: Iterable[int]) -> list[int]:
    """The packets that these packets and groups stand for. Raises ProtocolError for an unknown id."""
    singles = [single for packet in packets for single in GROUPS.get(packet, [packet])]
    if unknown := set(singles) - LAYOUT.keys():
        raise ProtocolError(f"Open Interface: there is no packet {min(unknown)}")
    return singles


def packets_bytes(packets: Iterable[int]) -> int:
    """Length of packets and groups sent one after the other. Raises ProtocolError for an unknown id."""
    return struct.calcsize(_layout(single_packets(packets)))


def decode_packets(data: bytes, packets: Iterable[int]) -> dict[int, int]:
    """Single packet id -> value of packets and groups sent one after the other; data must be exactly as long as they
    are."""
    singles = single_packets(packets)
    return dict(zip(singles, struct.unpack(_layout(singles), data)))


def encode_packets(values: Mapping[int, int]) -> bytes:
    """What the robot sends for these values, without their ids."""
    return struct.pack(_layout(values), *values.values())


class StreamParser:
    """Turns the byte stream of opcode 148 into {packet: value} frames; recovers after lost, added or changed bytes.

    The two manuals disagree whether the checksum includes the header byte. Either is accepted until LOCK_AFTER frames
    agreed; then the other one is an error. ``refused`` counts frames with a wrong length, checksum or packet.
    packets: the requested ones, if known: then a wrong length holds back no frames."""

    LOCK_AFTER = 3

    def __init__(self, packets: list[int] | None = None) -> None:
        self._length = None if packets is None else len(packets) + packets_bytes(packets)
        self.frames = 0
        self.refused = 0
        self._buffer = bytearray()
        self._agreed = {0: 0, STREAM_HEADER: 0}

    def feed(self, data: bytes) -> list[dict[int, int]]:
        """The frames completed by these bytes, in order."""
        self._buffer += data
        return list(iter(self._next, None))

    def _next(self) -> dict[int, int] | None:
        buffer = self._buffer
        while True:
            at = buffer.find(STREAM_HEADER)
            del buffer[: at if at >= 0 else len(buffer)]
            possible = len(buffer) < 2 or self._length in (None, buffer[1])
            if possible and (len(buffer) < 2 or len(buffer) < buffer[1] + 3):
                return None
            length = buffer[1]
            remainder = sum(buffer[: length + 3]) % 256
            accepted = possible and self._accepts(remainder)
            values = _stream_values(bytes(buffer[2 : length + 2])) if accepted else None
            if values is None:
                self.refused += 1
                del buffer[:1]
                continue
            self.frames += 1
            self._agreed[remainder] += 1
            del buffer[: length + 3]
            return values

    def _accepts(self, remainder: int) -> bool:
        """The sum of the whole frame is 0 when the checksum includes the header, else the header remains."""
        locked = max(self._agreed.values()) >= self.LOCK_AFTER
        return remainder in self._agreed and (not locked or self._agreed[remainder] >= self.LOCK_AFTER)


def _stream_values(content: bytes) -> dict[int, int] | None:
    """The packets of a stream frame, or None unless they fill it exactly."""
    values = {}
    at = 0
    while at < len(content):
        layout = LAYOUT.get(content[at])
        if layout is None or at + 1 + struct.calcsize(layout) > len(content):
            return None
        (values[content[at]],) = struct.unpack_from(">" + layout, content, at + 1)
        at += 1 + struct.calcsize(layout)
    return values or None


def encode_stream_frame(values: Mapping[int, int]) -> bytes:
    """What the robot streams for these values; the checksum includes the header."""
    content = b"".join(bytes((packet,)) + encode_packets({packet: value}) for packet, value in values.items())
    frame = bytes((STREAM_HEADER, len(content))) + content
    return frame + bytes((-sum(frame) % 256,))


def encode_drive_direct(left_mm_s: float, right_mm_s: float) -> bytes:
    """Wheel speeds, right one first on the wire. Both are scaled down alike to the robot's 500 mm/s, which keeps the
    curve. Raises ProtocolError for numbers that are not finite."""
    left, right = wheel_speeds(left_mm_s, right_mm_s)
    return struct.pack(">Bhh", Opcode.DRIVE_DIRECT, right, left)


def wheel_speeds(left_mm_s: float, right_mm_s: float) -> tuple[int, int]:
    """(left, right) as ``encode_drive_direct`` sends them."""
    if not (math.isfinite(left_mm_s) and math.isfinite(right_mm_s)):
        raise ProtocolError(f"drive: wheel speeds {left_mm_s}, {right_mm_s} mm/s are not finite; send numbers")
    scale = max(1.0, abs(left_mm_s) / SPEED_LIMIT_MM_S, abs(right_mm_s) / SPEED_LIMIT_MM_S)
    return round(left_mm_s / scale), round(right_mm_s / scale)


def encode_lamps(bits: int, color: int, intensity: int) -> bytes:
    """Lamps. bits: Create 1 2 play, 8 advance; Create 2 1 debris, 2 spot, 4 dock, 8 check. The power lamp's color runs
    from 0 green to 255 red. Raises ProtocolError for values outside 0..255."""
    if not all(0 <= value <= 255 for value in (bits, color, intensity)):
        raise ProtocolError(f"lamps: {bits}, {color}, {intensity}; each is a byte")
    return bytes((Opcode.LAMPS, bits, color, intensity))


def encode_song(number: int, notes: list[tuple[int, float]]) -> bytes:
    """Store a song: (MIDI note 31-127, duration [s]) each; numbers 0-4 exist on all robots. Raises ProtocolError
    for a number, a note, a duration or a count out of range."""
    if not (0 <= number <= 4 and 1 <= len(notes) <= 16):
        raise ProtocolError(f"song {number} of {len(notes)} notes; songs 0-4 hold 1 to 16 notes")
    content = b""
    for note, duration_s in notes:
        ticks = round(64 * duration_s) if math.isfinite(duration_s) else 0
        if not (31 <= note <= 127 and 1 <= ticks <= 255):
            raise ProtocolError(f"song: note {note} for {duration_s} s; notes are 31-127, up to 3.98 s long")
        content += bytes((note, ticks))
    return bytes((Opcode.SONG, number, len(notes))) + content


def encode_stream_request(packets: list[int], baud: int) -> bytes:
    """Ask for these packets every 15 ms. Raises ProtocolError when they do not fit into 15 ms at this baud rate."""
    needed = 3 + len(packets) + packets_bytes(packets)
    room = baud * STREAM_PERIOD_NS // 10_000_000_000
    if needed > room:
        raise ProtocolError(f"stream of {needed} bytes does not fit: {room} bytes pass in 15 ms at {baud} baud")
    return bytes((Opcode.STREAM, len(packets), *packets))


def encode_query(packets: list[int]) -> bytes:
    """Ask once for these packets; the answer is their data and nothing else."""
    return bytes((Opcode.QUERY_LIST, len(packets), *packets))


def encode_dock_character(red: bool, green: bool, field: bool, *, first: bool) -> int:
    """The character of a home base. first: of the generation of the Create 1; of the Roomba 600 else. 0 or 255 (first):
    no light."""
    if not (red or green or field):
        return 255 if first else 0
    return (240 if first else 160) + 8 * red + 4 * green + (2 if first else 1) * field


def dock_character(value: int) -> tuple[bool, bool, bool]:
    """Whether an infrared character holds the red buoy, the green buoy, the force field of a home base of either
    generation; nothing for other characters (162 is a virtual wall, 255 none)."""
    first = 240 <= value < 255 and not value & 1
    if not first and not (160 <= value <= 175 and not value & 2):
        return False, False, False
    return bool(value & 8), bool(value & 4), bool(value & (2 if first else 1))


def mode_of(value: int) -> Mode:
    """The mode of packet 35; anything undocumented is UNKNOWN."""
    return Mode(value) if 0 <= value <= 3 else Mode.UNKNOWN
