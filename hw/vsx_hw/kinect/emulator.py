"""A Kinect made of registers and packets, behind a Unix socket: the driver runs its real start sequence and assembles
real packets."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import struct
import threading
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vsx_hw.errors import DeviceError, ProtocolError
from vsx_hw.kinect import protocol
from vsx_hw.kinect import socket_transport as wire
from vsx_hw.kinect.protocol import CLOCK_HZ, MICROFRAME_NS, packetize

logger = logging.getLogger(__name__)

PACKETS_PER_TRANSFER = 32  # as usb_transport.py asks for
_SEND_TIMEOUT = struct.pack("ll", 1, 0)  # struct timeval: one second
_SETTINGS = (0x0C, 0x0D, 0x0E)  # registers of format, resolution and rate
AUTOMATIC = 0x708E  # Register EXPOSURE_MODES after power-on: everything automatic


class KinectBoard:
    """The camera's registers, those of its image sensor (``cmos``, kept while the camera has power), and its packet
    counter."""

    def __init__(self) -> None:
        self.registers: dict[int, int] = {}
        self.cmos: dict[int, int] = {protocol.EXPOSURE_MODES: AUTOMATIC}
        self._reply = b""
        self._sequence = 0

    def control_out(self, message: bytes) -> None:
        """Write a register, or read or write the image sensor; an invalid message gets no reply."""
        self._reply = b""
        try:
            command, tag, words = protocol.decode_message(message)
        except ProtocolError:
            return
        if command == protocol.WRITE_REGISTER and len(words) == 2:
            self.registers[words[0]] = words[1]
            self._reply = protocol.encode_reply(command, tag, 0)
        elif command == protocol.CMOS_REGISTER and len(words) == 3:
            address = words[1] & ~protocol.CMOS_WRITE
            if words[1] & protocol.CMOS_WRITE:
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
        """The mode that the registers select; None for any other combination."""
        selected = {address: self.registers.get(address) for address in _SETTINGS}
        return next((m for m in protocol.MODES.values() if selected.items() <= dict(m.start).items()), None)

    def packets(self, image: NDArray[np.uint8], clock_ticks: int) -> list[bytes]:
        """The packets of the next frame."""
        packets = packetize(image, clock_ticks, self._sequence)
        self._sequence += len(packets)
        return packets


class KinectEmulator:
    """Listens at a socket path, serves one driver at a time; ``send_frame`` gives it an image. Usable as a context
    manager. Faults that may be changed while it runs: drop_rate of packets, silent."""

    def __init__(self, path: str, seed: int = 0) -> None:
        self.board = KinectBoard()
        self.drop_rate, self.silent = 0.0, False
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
        """Send an image whose first row left the sensor at host time start_ns. False when it is not sent: no driver
        listens, or the image does not fit the mode."""
        with self._lock:
            mode = self.board.mode
            if self._client is None or not self.streaming or self.silent or mode is None:
                return False
            if image.size != mode.frame_bytes:
                return False
            packets = self.board.packets(image, start_ns * (CLOCK_HZ // 1_000_000) // 1000)
            kept = self._rng.random(len(packets)) >= self.drop_rate
            try:
                for first in range(0, len(packets), PACKETS_PER_TRANSFER):
                    transfer = slice(first, first + PACKETS_PER_TRANSFER)
                    sent = list(compress(packets[transfer], kept[transfer]))
                    wire.send(self._client, wire.PACKETS, wire.encode_packets(start_ns + first * MICROFRAME_NS, sent))
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
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _SEND_TIMEOUT)
            with self._lock:
                board, self.board = self.board, KinectBoard()
                self.board.cmos = board.cmos
                self._client, self._receiving = client, False
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
