"""The camera's side of the stream: an image as the isochronous packets that carry it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsx_hw.kinect.protocol import (
    FLAG_END,
    FLAG_MIDDLE,
    FLAG_START,
    HEADER_BYTES,
    PACKET_BYTES,
    PACKET_DATA_BYTES,
    PACKET_MAGIC,
)


def packetize(
    image: NDArray[np.uint8], clock_ticks: int, first_sequence: int
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(N, 1920) packets and their (N,) lengths for an image of any mode, 162 for a VGA mosaic; the next sequence number
    is first_sequence + N, modulo 256."""
    pixels = image.reshape(-1)
    count = -(-len(pixels) // PACKET_DATA_BYTES)
    packets = np.zeros((count, PACKET_BYTES), np.uint8)
    packets[:, :2] = PACKET_MAGIC
    packets[:, 3] = FLAG_MIDDLE
    packets[0, 3], packets[-1, 3] = FLAG_START, FLAG_END
    packets[:, 5] = (first_sequence + np.arange(count)) % 256
    packets[:, 8:12] = np.frombuffer((clock_ticks % 2**32).to_bytes(4, "little"), np.uint8)
    whole = (count - 1) * PACKET_DATA_BYTES
    packets[:-1, HEADER_BYTES:] = pixels[:whole].reshape(-1, PACKET_DATA_BYTES)
    packets[-1, HEADER_BYTES : HEADER_BYTES + len(pixels) - whole] = pixels[whole:]
    lengths = np.full(count, PACKET_BYTES, np.int64)
    lengths[-1] = HEADER_BYTES + len(pixels) - whole
    return packets, lengths
