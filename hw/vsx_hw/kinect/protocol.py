"""Kinect v1 colour camera: control messages, registers and isochronous packet headers. No I/O.

Sources: OpenKinect protocol documentation; libfreenect cameras.c; Linux gspca kinect.c (facts only).
Control: OUT ``47 4D`` words command tag payload, IN ``52 42`` words command tag payload, u16 little endian.
Stream: packets of at most 1920 bytes, 12 of them header: ``52 42``, pad, flag, pad, sequence, 2 pad, u32 60 MHz clock.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from vsx_hw.errors import ProtocolError

WIDTH_PX, HEIGHT_PX = 640, 480
FRAME_BYTES = WIDTH_PX * HEIGHT_PX
CLOCK_HZ, CLOCK_BITS = 60_000_000, 32

REPLY_BYTES = 0x200
_REQUEST, _REPLY = 0x4D47, 0x4252
_WRITE_REGISTER = 0x03

PACKET_BYTES = 1920
HEADER_BYTES = 12
PACKET_DATA_BYTES = PACKET_BYTES - HEADER_BYTES
PACKETS_PER_FRAME = -(-FRAME_BYTES // PACKET_DATA_BYTES)
MICROFRAME_NS = 125_000
PACKET_MAGIC = (0x52, 0x42)
FLAG_START, FLAG_MIDDLE, FLAG_END = 0x81, 0x82, 0x85


class Register(NamedTuple):
    """One write: a register and its value."""

    address: int
    value: int


STREAM_SWITCH = 0x05
START_VGA_BAYER = (
    Register(0x0C, 0x00),  # format: Bayer
    Register(0x0D, 0x01),  # resolution: 640 x 480
    Register(0x0E, 0x1E),  # 30 frames a second
    Register(STREAM_SWITCH, 0x01),
    Register(0x47, 0x00),  # not mirrored
)
STOP = (Register(STREAM_SWITCH, 0x00),)


def encode_write(register: Register, tag: int) -> bytes:
    """The control message that writes a register."""
    return struct.pack("<6H", _REQUEST, 2, _WRITE_REGISTER, tag & 0xFFFF, register.address, register.value)


def check_write_reply(reply: bytes, register: Register, tag: int) -> None:
    """Raises ProtocolError unless the reply belongs to the write of this register with this tag."""
    if len(reply) < 8:
        raise ProtocolError(f"Kinect: reply of {len(reply)} bytes to register 0x{register.address:02X}; replug it")
    magic, words, command, got_tag = struct.unpack_from("<4H", reply)
    if (magic, command, got_tag) != (_REPLY, _WRITE_REGISTER, tag & 0xFFFF) or len(reply) != 8 + 2 * words:
        raise ProtocolError(
            f"Kinect: reply {reply[:10].hex(' ')} does not answer register 0x{register.address:02X}, tag {tag}; replug"
        )


def decode_write(message: bytes) -> tuple[Register, int]:
    """(register, tag) of a control message, as the camera reads it. Raises ProtocolError for anything else."""
    if len(message) != 12:
        raise ProtocolError(f"Kinect: control message of {len(message)} bytes, 12 expected for a register write")
    magic, words, command, tag, address, value = struct.unpack("<6H", message)
    if (magic, words, command) != (_REQUEST, 2, _WRITE_REGISTER):
        raise ProtocolError(f"Kinect: control message {message.hex(' ')} is not a register write")
    return Register(address, value), tag


def encode_write_reply(tag: int) -> bytes:
    """The camera's answer to a register write."""
    return struct.pack("<5H", _REPLY, 1, _WRITE_REGISTER, tag, 0)
