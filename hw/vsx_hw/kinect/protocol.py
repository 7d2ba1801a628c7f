"""Kinect v1 colour camera: control messages, registers and image formats. No I/O.

Sources: OpenKinect protocol documentation; libfreenect cameras.c; Linux gspca kinect.c (facts only).
Control: OUT ``47 4D`` words command tag payload, IN ``52 42`` words command tag payload, u16 little endian.
"""

import struct
from typing import NamedTuple

from vsx_hw.errors import ProtocolError

REPLY_BYTES = 0x200  # most of an answer
_REQUEST, _REPLY = 0x4D47, 0x4252  # magic words
WRITE_REGISTER, CMOS_REGISTER = 0x03, 0x95  # commands
CMOS_WRITE = 0x8000  # bit of the address: write, not read


class Register(NamedTuple):
    """One write: a register and its value."""

    address: int
    value: int


STREAM_SWITCH, DEPTH_SWITCH = 0x05, 0x06  # registers
_OFF = (Register(0x105, 0x00), Register(STREAM_SWITCH, 0x00))  # the streams
_ON = (Register(STREAM_SWITCH, 0x01), Register(0x47, 0x00))  # 0x47: not mirrored
_WAKE_DEPTH = (Register(0x13, 0x01), Register(0x14, 0x1E), Register(DEPTH_SWITCH, 0x02), Register(DEPTH_SWITCH, 0x00))
STOP = (Register(STREAM_SWITCH, 0x00),)  # the video stream


class StreamMode(NamedTuple):
    """An image format: size, bytes a pixel, frames a second, and the register writes that start it."""

    name: str
    width_px: int
    height_px: int
    pixel_bytes: int
    rate_hz: int
    start: tuple[Register, ...]

    @property
    def frame_bytes(self) -> int:
        """Bytes of one image."""
        return self.width_px * self.height_px * self.pixel_bytes


def _settings(image_format: int, resolution: int, rate_hz: int) -> tuple[Register, ...]:
    """0x0C format: 0 Bayer, 5 UYVY. 0x0D resolution: 1 VGA, 2 SXGA. 0x0E frames a second."""
    return (Register(0x0C, image_format), Register(0x0D, resolution), Register(0x0E, rate_hz))


VGA_BAYER = StreamMode("vga", 640, 480, 1, 30, (*_settings(0, 1, 30), *_ON))  # format, resolution, images a second
VGA_UYVY = StreamMode("uyvy", 640, 480, 2, 15, (*_settings(5, 1, 15), *_ON))  # as above
SXGA_BAYER = StreamMode("sxga", 1280, 1024, 1, 10, (*_OFF, *_WAKE_DEPTH, *_settings(0, 2, 15), *_ON))
"""Asked for 15, delivers about 10 a second. The firmware refuses it unless the depth stream was switched on and off."""

MODES = {mode.name: mode for mode in (VGA_BAYER, VGA_UYVY, SXGA_BAYER)}

EXPOSURE_MODES = 0x0106
"""CMOS register, Micron MT9M112 data sheet: bit 14 automatic exposure, bit 1 automatic white balance."""
AUTOMATIC_EXPOSURE, AUTOMATIC_WHITE_BALANCE = 1 << 14, 1 << 1  # bits of EXPOSURE_MODES


def _message(magic: int, command: int, tag: int, *words: int) -> bytes:
    return struct.pack(f"<{4 + len(words)}H", magic, len(words), command, tag & 0xFFFF, *words)


def encode_write(register: Register, tag: int) -> bytes:
    """The control message that writes a register."""
    return _message(_REQUEST, WRITE_REGISTER, tag, *register)


def encode_cmos_read(address: int, tag: int) -> bytes:
    """The control message that reads a register of the image sensor."""
    return _message(_REQUEST, CMOS_REGISTER, tag, 1, address, 0)


def encode_cmos_write(register: Register, tag: int) -> bytes:
    """The control message that writes a register of the image sensor."""
    return _message(_REQUEST, CMOS_REGISTER, tag, 1, register.address | CMOS_WRITE, register.value)


def decode_reply(reply: bytes, command: int, tag: int) -> tuple[int, ...]:
    """The words of the reply to a message. Raises ProtocolError unless it answers this command with this tag."""
    if len(reply) < 8:
        raise ProtocolError(f"Kinect: reply of {len(reply)} bytes to command 0x{command:02X}; replug it")
    magic, words, got_command, got_tag = struct.unpack_from("<4H", reply)
    if (magic, got_command, got_tag) != (_REPLY, command, tag & 0xFFFF) or len(reply) != 8 + 2 * words:
        raise ProtocolError(
            f"Kinect: reply {reply[:10].hex(' ')} does not answer command 0x{command:02X}, tag {tag}; replug it"
        )
    return struct.unpack_from(f"<{words}H", reply, 8)


def decode_message(message: bytes) -> tuple[int, int, tuple[int, ...]]:
    """(command, tag, words) of a control message, as the camera reads it. Raises ProtocolError for anything else."""
    magic, words, command, tag = struct.unpack_from("<4H", message.ljust(8, b"\0"))
    if magic != _REQUEST or len(message) != 8 + 2 * words:
        raise ProtocolError(f"Kinect: {message[:12].hex(' ')} is not a control message")
    return command, tag, struct.unpack_from(f"<{words}H", message, 8)


def encode_reply(command: int, tag: int, *words: int) -> bytes:
    """The camera's answer."""
    return struct.pack(f"<{4 + len(words)}H", _REPLY, len(words), command, tag, *words)
