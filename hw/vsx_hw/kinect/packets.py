"""Isochronous packets of the camera: from an image, as the camera sends them, and to complete images again.

At most 1920 bytes, 12 of them header: ``52 42``, pad, flag, pad, sequence, 2 pad, u32 60 MHz clock, little endian.
"""

import struct
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_hw.kinect.protocol import VGA_BAYER, StreamMode

PACKET_BYTES = 1920  # most of an isochronous packet
MAGIC, FLAG_START, FLAG_MIDDLE, FLAG_END = b"\x52\x42", 0x81, 0x82, 0x85  # of the protocol
_HEADER = struct.Struct("<2sxBxB2xI")
HEADER_BYTES = _HEADER.size
PACKET_DATA_BYTES = PACKET_BYTES - HEADER_BYTES
CLOCK_HZ, CLOCK_BITS = 60_000_000, 32  # of the stamps in packets
MICROFRAME_NS = 125_000  # of USB 2: a packet in each

PacketHandler = Callable[[int, list[bytes]], None]
"""Called with the host time of arrival [ns] and packets in order, on the transport's thread."""


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
    """``feed`` packets in order of arrival; ``counters`` goes on with frames, torn_frames and bad_packets. A torn frame
    is counted and dropped: half an image of the past under half an image of now is worse for tracking than none."""

    def __init__(self, mode: StreamMode = VGA_BAYER, counters: Counter[str] | None = None) -> None:
        self._size = mode.frame_bytes
        self._shape = (mode.height_px, mode.width_px) + ((mode.pixel_bytes,) if mode.pixel_bytes > 1 else ())
        self.counters = Counter(frames=0, torn_frames=0, bad_packets=0) if counters is None else counters
        self._pixels: bytearray | None = None  # of the open frame
        self._ended = False  # a frame has just come to its end
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
