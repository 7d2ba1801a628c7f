"""A Kinect made of registers and packets, behind a Unix socket: the driver runs its real start sequence and its real
assembler."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsx_hw.errors import DeviceError, ProtocolError
from vsx_hw.kinect import protocol, wire

logger = logging.getLogger(__name__)

PACKETS_PER_TRANSFER = 32
SEND_TIMEOUT_S = 1.0


@dataclass
class KinectFaults:
    """What goes wrong; may be changed while the emulator runs."""

    drop_rate: float = 0.0
    silent: bool = False


_SETTINGS = (0x0C, 0x0D, 0x0E)
AUTOMATIC = 0x708E
"""Register EXPOSURE_MODES after power-on: everything automatic."""


class KinectBoard:
    """The camera's registers, those of its image sensor (``cmos``), and its packet counter."""

    def __init__(self) -> None:
        self.registers: dict[int, int] = {}
        self.cmos: dict[int, int] = {protocol.EXPOSURE_MODES: AUTOMATIC}
        self._reply = b""
        self._sequence = 0

    def control_out(self, message: bytes) -> None:
        """Obey a write, read or write the sensor; nonsense gets no reply."""
        self._reply = b""
        try:
            command, tag, words = protocol.decode_message(message)
        except ProtocolError:
            return
        if command == protocol.WRITE_REGISTER and len(words) == 2:
            self.registers[words[0]] = words[1]
            self._reply = protocol.encode_reply(command, tag, 0)
        elif command == protocol.CMOS_REGISTER and len(words) == 3:
            address = words[1] & 0x7FFF
            if words[1] & 0x8000:
                self.cmos[address] = words[2]
            self._reply = protocol.encode_reply(command, tag, 1, words[1], self.cmos.get(address, 0))

    def control_in(self) -> bytes:
        """The reply to the last message, once."""
        reply, self._reply = self._reply, b""
        return reply

    @property
    def streaming(self) -> bool:
        """Whether the stream is on, in one of the modes."""
        return self.registers.get(protocol.STREAM_SWITCH) == 1 and self.mode is not None

    @property
    def mode(self) -> protocol.StreamMode | None:
        """The mode that the registers select, None for a combination that is none."""
        selected = [self.registers.get(address) for address in _SETTINGS]
        for mode in protocol.MODES.values():
            wanted = dict(mode.start)
            if selected == [wanted[address] for address in _SETTINGS]:
                return mode
        return None

    def packets(self, image: NDArray[np.uint8], clock_ticks: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The packets of the next frame."""
        packets, lengths = packetize(image, clock_ticks, self._sequence)
        self._sequence = (self._sequence + len(lengths)) % 256
        return packets, lengths


class KinectEmulator:
    """Listens at a socket path, serves one driver at a time; ``send_frame`` gives it an image. Usable as a context
    manager."""

    def __init__(self, path: str, seed: int = 0) -> None:
        self.board = KinectBoard()
        self.faults = KinectFaults()
        self._path = path
        self._rng = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._client: socket.socket | None = None
        self._receiving = False
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(path)
        self._listener.listen(1)
        self._thread = threading.Thread(target=self._accept, name="emulated kinect", daemon=True)
        self._thread.start()

    def __enter__(self) -> KinectEmulator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def streaming(self) -> bool:
        """Whether a driver has switched the stream on and listens."""
        return self._receiving and self.board.streaming

    def send_frame(self, image: NDArray[np.uint8], start_ns: int) -> bool:
        """Send an image whose first row left the sensor at host time start_ns; False when nobody listens, or wants
        another mode."""
        with self._lock:
            mode = self.board.mode
            if self._client is None or not self.streaming or self.faults.silent or mode is None:
                return False
            if image.size != mode.frame_bytes:
                return False
            packets, lengths = self.board.packets(image, start_ns * (protocol.CLOCK_HZ // 1_000_000) // 1000)
            kept = np.flatnonzero(self._rng.random(len(lengths)) >= self.faults.drop_rate)
            try:
                for first in range(0, len(lengths), PACKETS_PER_TRANSFER):
                    rows = kept[(kept >= first) & (kept < first + PACKETS_PER_TRANSFER)]
                    body = wire.encode_packets(start_ns + first * protocol.MICROFRAME_NS, packets[rows], lengths[rows])
                    wire.send(self._client, wire.PACKETS, body)
            except DeviceError as error:
                logger.warning("%s", error)
                return False
            return True

    def unplug(self) -> None:
        """Cut the connection; the driver may connect again at once."""
        with self._lock:
            if self._client is not None:
                with contextlib.suppress(OSError):
                    self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Remove the socket."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.unplug()
        self._thread.join(timeout=2.0)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self._path)

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.settimeout(None)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(SEND_TIMEOUT_S))
            with self._lock:
                self._client, self.board, self._receiving = client, KinectBoard(), False
            self._obey(client)
            with self._lock:
                self._client, self._receiving = None, False
            client.close()

    def _obey(self, client: socket.socket) -> None:
        try:
            while True:
                kind, body = wire.receive(client)
                if kind == wire.CONTROL_OUT:
                    self.board.control_out(body)
                elif kind == wire.CONTROL_IN:
                    with self._lock:
                        wire.send(client, wire.REPLY, self.board.control_in())
                elif kind in (wire.START, wire.STOP):
                    self._receiving = kind == wire.START
        except DeviceError as error:
            logger.debug("%s", error)


def _timeval(seconds: float) -> bytes:
    whole = int(seconds)
    return whole.to_bytes(8, "little") + round((seconds - whole) * 1e6).to_bytes(8, "little")


def packetize(
    image: NDArray[np.uint8], clock_ticks: int, first_sequence: int
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(N, 1920) packets and their (N,) lengths for an image of any mode, 162 for a VGA mosaic; the next sequence number
    is first_sequence + N, modulo 256."""
    pixels = image.reshape(-1)
    count = -(-len(pixels) // protocol.PACKET_DATA_BYTES)
    packets = np.zeros((count, protocol.PACKET_BYTES), np.uint8)
    packets[:, :2] = protocol.PACKET_MAGIC
    packets[:, 3] = protocol.FLAG_MIDDLE
    packets[0, 3], packets[-1, 3] = protocol.FLAG_START, protocol.FLAG_END
    packets[:, 5] = (first_sequence + np.arange(count)) % 256
    packets[:, 8:12] = np.frombuffer((clock_ticks % 2**32).to_bytes(4, "little"), np.uint8)
    whole = (count - 1) * protocol.PACKET_DATA_BYTES
    packets[:-1, protocol.HEADER_BYTES :] = pixels[:whole].reshape(-1, protocol.PACKET_DATA_BYTES)
    packets[-1, protocol.HEADER_BYTES : protocol.HEADER_BYTES + len(pixels) - whole] = pixels[whole:]
    lengths = np.full(count, protocol.PACKET_BYTES, np.int64)
    lengths[-1] = protocol.HEADER_BYTES + len(pixels) - whole
    return packets, lengths
