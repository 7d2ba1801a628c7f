"""From isochronous packets to complete images. A torn frame is counted and dropped: half an image of the past under
half an image of now is worse for tracking than none."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_hw.kinect.protocol import (
    FLAG_END,
    FLAG_MIDDLE,
    FLAG_START,
    HEADER_BYTES,
    PACKET_BYTES,
    PACKET_MAGIC,
    VGA_BAYER,
    StreamMode,
)

Bytes = NDArray[np.uint8]
BETWEEN_FRAMES, SKIPPING = -1, -2


class RawFrame(NamedTuple):
    """A complete image, (H, W) mosaic or (H, W, 2) UYVY, the camera's 60 MHz clock at its last packet, and the arrival
    of its first one."""

    clock_ticks: int
    first_arrival_ns: int
    image: Bytes


class FrameAssembler:
    """``feed`` batches of packets in order of arrival; ``counters`` tell frames, torn_frames and bad_packets."""

    def __init__(self, mode: StreamMode = VGA_BAYER) -> None:
        self._size = mode.frame_bytes
        self._shape = (mode.height_px, mode.width_px) + ((mode.pixel_bytes,) if mode.pixel_bytes > 1 else ())
        self.counters: Counter[str] = Counter(frames=0, torn_frames=0, bad_packets=0)
        self._image = np.empty(self._size, np.uint8)
        self._filled = SKIPPING  # bytes of the open frame, or one of the two states above
        self._sequence = -1
        self._first_arrival_ns = 0

    def feed(self, arrival_ns: int, packets: Bytes, lengths: NDArray[np.int64]) -> list[RawFrame]:
        """The frames completed by these packets. packets: (N, 1920), row i holds packet i. lengths: (N,) bytes
        received; 0 is an idle slot."""
        good = np.flatnonzero(self._is_video(packets, lengths))
        self.counters["bad_packets"] += int(np.count_nonzero(lengths)) - len(good)
        if not len(good):
            return []
        flags, sequence = packets[good, 3], packets[good, 5].astype(np.int64)
        previous = np.concatenate([[self._sequence], sequence[:-1]])
        lost = (sequence - previous) % 256 != 1
        lost[0] &= self._sequence >= 0
        self._sequence = int(sequence[-1])
        after_end = np.concatenate([[False], flags[:-1] == FLAG_END])
        cuts = np.flatnonzero(lost | (flags == FLAG_START) | after_end)
        bounds = np.unique(np.concatenate([[0], cuts, [len(good)]]))
        found = []
        for first, last in zip(bounds[:-1], bounds[1:]):
            frame = self._take(arrival_ns, packets, lengths, good[first:last], bool(lost[first]))
            if frame is not None:
                found.append(frame)
        return found

    @staticmethod
    def _is_video(packets: Bytes, lengths: NDArray[np.int64]) -> NDArray[np.bool_]:
        flags = packets[:, 3]
        known = (flags == FLAG_START) | (flags == FLAG_MIDDLE) | (flags == FLAG_END)
        magic = (packets[:, 0] == PACKET_MAGIC[0]) & (packets[:, 1] == PACKET_MAGIC[1])
        video: NDArray[np.bool_] = known & magic & (lengths > HEADER_BYTES) & (lengths <= PACKET_BYTES)
        return video

    def _take(
        self, arrival_ns: int, packets: Bytes, lengths: NDArray[np.int64], rows: NDArray[np.intp], lost: bool
    ) -> RawFrame | None:
        """A run without gap, start flag only at its beginning, end flag only at its end."""
        starts = packets[rows[0], 3] == FLAG_START
        if (self._filled >= 0 and (starts or lost)) or (self._filled == BETWEEN_FRAMES and not starts):
            self._tear()
        if starts:
            self._filled, self._first_arrival_ns = 0, arrival_ns
        if self._filled < 0:
            return None
        data = self._data(packets, lengths, rows)
        if self._filled + len(data) > self._size:
            self._tear()
            return None
        self._image[self._filled : self._filled + len(data)] = data
        self._filled += len(data)
        if packets[rows[-1], 3] != FLAG_END:
            return None
        if self._filled < self._size:
            self._tear()
            return None
        return self._finish(packets[rows[-1]])

    @staticmethod
    def _data(packets: Bytes, lengths: NDArray[np.int64], rows: NDArray[np.intp]) -> Bytes:
        """The payload of the rows; all but the last packet of a frame are full, which makes it one copy."""
        sizes = lengths[rows]
        full = int(np.argmax(sizes != PACKET_BYTES)) if (sizes != PACKET_BYTES).any() else len(rows)
        parts = [packets[rows[:full], HEADER_BYTES:].reshape(-1)]
        parts += [packets[row, HEADER_BYTES : lengths[row]] for row in rows[full:]]
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _finish(self, last_packet: Bytes) -> RawFrame:
        clock_ticks = int.from_bytes(last_packet[8:12].tobytes(), "little")
        image = self._image.reshape(self._shape)
        self._image = np.empty(self._size, np.uint8)
        self._filled = BETWEEN_FRAMES
        self.counters["frames"] += 1
        return RawFrame(clock_ticks, self._first_arrival_ns, image)

    def _tear(self) -> None:
        self.counters["torn_frames"] += 1
        self._filled = SKIPPING
