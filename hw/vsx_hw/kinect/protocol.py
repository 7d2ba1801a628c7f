"""Kinect v1 colour camera: control messages, registers, image formats, and packets from images and back. No I/O.

Sources: OpenKinect protocol documentation; libfreenect cameras.c; Linux gspca kinect.c (facts only).
Control: OUT ``47 4D`` words command tag payload, IN ``52 42`` words command tag payload, u16 little endian.
Packets: isochronous, at most 1920 bytes, 12 of them header: ``52 42``, pad, flag, pad, sequence, 2 pad, u32 60 MHz
clock, little endian."""

import struct
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_hw.errors import ProtocolError

REPLY_BYTES = 0x200  # longest answer
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
    """An image format: size, bytes per pixel, frames per second, and the register writes that start it."""

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
    """0x0C format: 0 Bayer, 5 UYVY. 0x0D resolution: 1 VGA, 2 SXGA. 0x0E frames per second."""
    return (Register(0x0C, image_format), Register(0x0D, resolution), Register(0x0E, rate_hz))


VGA_BAYER = StreamMode("vga", 640, 480, 1, 30, (*_settings(0, 1, 30), *_ON))  # format, resolution, images per second
VGA_UYVY = StreamMode("uyvy", 640, 480, 2, 15, (*_settings(5, 1, 15), *_ON))  # as above
SXGA_BAYER = StreamMode("sxga", 1280, 1024, 1, 10, (*_OFF, *_WAKE_DEPTH, *_settings(0, 2, 15), *_ON))
"""Delivers about 10 of the requested 15 images per second. The firmware refuses it unless the depth stream was switched
on and off."""

MODES = {mode.name: mode for mode in (VGA_BAYER, VGA_UYVY, SXGA_BAYER)}

PACKET_BYTES = 1920  # longest isochronous packet
MAGIC, FLAG_START, FLAG_MIDDLE, FLAG_END = b"\x52\x42", 0x81, 0x82, 0x85  # of the protocol
_HEADER = struct.Struct("<2sxBxB2xI")
HEADER_BYTES = _HEADER.size
PACKET_DATA_BYTES = PACKET_BYTES - HEADER_BYTES
CLOCK_HZ, CLOCK_BITS = 60_000_000, 32  # of the stamps in packets
MICROFRAME_NS = 125_000  # of USB 2; each holds one packet

PacketHandler = Callable[[int, list[bytes]], None]
"""Called with the host time of arrival [ns] and packets in order, on the transport's thread."""

EXPOSURE_MODES = 0x0106
"""CMOS register, Micron MT9M112 data sheet: bit 14 automatic exposure, bit 1 automatic white balance."""
AUTOMATIC_EXPOSURE, AUTOMATIC_WHITE_BALANCE = 1 << 14, 1 << 1  # bits of EXPOSURE_MODES


def encode_message(command: int, tag: int, *words: int, magic: int = _REQUEST) -> bytes:
    """A control message. Words of WRITE_REGISTER: register, value. Words of CMOS_REGISTER (image sensor): 1, address,
    and the value with CMOS_WRITE, else 0."""
    return struct.pack(f"<{4 + len(words)}H", magic, len(words), command, tag & 0xFFFF, *words)


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
    return encode_message(command, tag, *words, magic=_REPLY)


def packetize(image: NDArray[np.uint8], clock_ticks: int, first_sequence: int) -> list[bytes]:
    """The packets of an image of any mode, 162 for a VGA mosaic. The sequence number counts them, modulo 256."""
    pixels = image.tobytes()
    parts = [pixels[at : at + PACKET_DATA_BYTES] for at in range(0, len(pixels), PACKET_DATA_BYTES)]
    flags = [FLAG_START, *[FLAG_MIDDLE] * (len(parts) - 2), FLAG_END]
    return [
        _HEADER.pack(MAGIC, flag, (first_sequence + k) % 256, clock_ticks % 2**CLOCK_BITS) + part
        for k, (flag, part) in enumerate(zip(flags, parts))
    ]


class RawFrame(NamedTuple):
    """A complete image, (H, W) mosaic or (H, W, 2) UYVY, the camera's 60 MHz clock at its last packet, and the arrival
    of its first one [ns]."""

    clock_ticks: int
    first_arrival_ns: int
    image: NDArray[np.uint8]


class FrameAssembler:
    """Call ``feed`` with packets in order of arrival; ``counters`` counts frames, torn_frames and bad_packets. A torn
    frame is counted and dropped: an image that is half old and half new is worse for tracking than none."""

    def __init__(self, mode: StreamMode = VGA_BAYER, counters: Counter[str] | None = None) -> None:
        self._size = mode.frame_bytes
        self._shape = (mode.height_px, mode.width_px) + ((mode.pixel_bytes,) if mode.pixel_bytes > 1 else ())
        self.counters = Counter(frames=0, torn_frames=0, bad_packets=0) if counters is None else counters
        self._pixels: bytearray | None = None  # of the open frame
        self._ended = False  # a frame has just ended
        self._sequence: int | None = None
        self._first_arrival_ns = 0

    def feed(self, arrival_ns: int, packets: list[bytes]) -> list[RawFrame]:
        """The frames completed by these packets; an empty packet is an idle slot."""
        taken = [self._take(arrival_ns, packet) for packet in packets if packet]
        return [frame for frame in taken if frame is not None]

    def _take(self, arrival_ns: int, packet: bytes) -> RawFrame | None:
        if not HEADER_BYTES < len(packet) <= PACKET_BYTES:
            self.counters["bad_packets"] += 1
            return None
        magic, flag, sequence, clock_ticks = _HEADER.unpack_from(packet)
        if magic != MAGIC or flag not in (FLAG_START, FLAG_MIDDLE, FLAG_END):
            self.counters["bad_packets"] += 1
            return None
        starts, lost = flag == FLAG_START, self._sequence not in (None, (sequence - 1) % 256)
        self._sequence = sequence
        if (self._pixels is not None and (starts or lost)) or (self._ended and not starts):
            self._tear()
        if starts:
            self._pixels, self._ended, self._first_arrival_ns = bytearray(), False, arrival_ns
        if self._pixels is None:
            return None
        self._pixels += packet[HEADER_BYTES:]
        if len(self._pixels) > self._size or (flag == FLAG_END and len(self._pixels) < self._size):
            self._tear()
        elif flag == FLAG_END:
            image = np.frombuffer(self._pixels, np.uint8).reshape(self._shape)
            self._pixels, self._ended = None, True
            self.counters["frames"] += 1
            return RawFrame(clock_ticks, self._first_arrival_ns, image)
        return None

    def _tear(self) -> None:
        self.counters["torn_frames"] += 1
        self._pixels, self._ended = None, False
