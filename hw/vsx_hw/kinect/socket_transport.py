"""The emulated USB cable, a Unix stream socket between a driver and an emulated Kinect, and the driver's end of it.

``kind, length, body``. Kinds from the driver: O control out, I control in, S start and X stop receiving packets.
From the camera: R reply to I, P packets: i64 bus time [ns], u16 count, u16 lengths, then the packets.
The bus time says when the packets would have been on the wire; a host controller knows it as the frame number. An
emulated image is rendered after its exposure, so its arrival on the socket says nothing about its age."""

import contextlib
import queue
import socket
import struct
import threading
from itertools import accumulate, pairwise

from vsx_hw.errors import DeviceError, DeviceNotFound, ProtocolError
from vsx_hw.kinect.protocol import PACKET_BYTES, PacketHandler

CONTROL_OUT, CONTROL_IN, START, STOP, REPLY, PACKETS = b"O", b"I", b"S", b"X", b"R", b"P"
REPLY_WAIT_S = 0.5  # as the wire's CONTROL_TIMEOUT_MS
_HEAD = struct.Struct("<cI")
_LONGEST_BODY = 1 << 20  # longer than a transfer: not this protocol


def send(connection: socket.socket, kind: bytes, body: bytes = b"") -> None:
    """Send one message. Raises DeviceError when the other side is gone or does not read."""
    try:
        connection.sendall(_HEAD.pack(kind, len(body)) + body)
    except OSError as error:
        raise DeviceError(f"emulated Kinect: connection lost ({error})") from error


def receive(connection: socket.socket) -> tuple[bytes, bytes]:
    """(kind, body) of the next message. Raises DeviceError when the other side is gone."""
    kind, length = _HEAD.unpack(_exactly(connection, _HEAD.size))
    if length > _LONGEST_BODY:
        raise ProtocolError(f"emulated Kinect: message of {length} bytes; the other side speaks something else")
    return kind, _exactly(connection, length)


def _exactly(connection: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        try:
            got = connection.recv(count - len(data))
        except OSError as error:
            raise DeviceError(f"emulated Kinect: connection lost ({error})") from error
        if not got:
            raise DeviceError("emulated Kinect: unplugged")
        data += got
    return bytes(data)


def encode_packets(bus_time_ns: int, packets: list[bytes]) -> bytes:
    """The body of a P message."""
    return struct.pack(f"<qH{len(packets)}H", bus_time_ns, len(packets), *map(len, packets)) + b"".join(packets)


def decode_packets(body: bytes) -> tuple[int, list[bytes]]:
    """(bus time [ns], packets). Raises ProtocolError when the sizes disagree."""
    if len(body) < 10:
        raise ProtocolError(f"emulated Kinect: packet message of {len(body)} bytes")
    bus_time_ns, count = struct.unpack_from("<qH", body)
    lengths = struct.unpack_from(f"<{count}H", body.ljust(10 + 2 * count), 10)
    if 10 + 2 * count + sum(lengths) != len(body) or max(lengths, default=0) > PACKET_BYTES:
        raise ProtocolError("emulated Kinect: packet lengths do not add up to the message")
    return bus_time_ns, [body[a:b] for a, b in pairwise(accumulate(lengths, initial=10 + 2 * count))]


class SocketTransport:
    """Connects to the emulator's socket; see ``KinectTransport``. Raises DeviceNotFound when no emulator listens
    there."""

    serial = "emulated"

    def __init__(self, path: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise DeviceNotFound(f"{path}: no emulated Kinect there ({error.strerror}); start the emulator") from error
        self._replies: queue.Queue[bytes] = queue.Queue()
        self._handler: PacketHandler | None = None
        self._handing_over = threading.Lock()
        self.failure = ""
        self._closed = False
        self._thread = threading.Thread(target=self._listen, name="emulated usb", daemon=True)
        self._thread.start()

    def control_out(self, data: bytes) -> None:
        """See KinectTransport."""
        send(self._socket, CONTROL_OUT, data)

    def control_in(self, size: int) -> bytes:
        """See KinectTransport."""
        send(self._socket, CONTROL_IN, size.to_bytes(2, "little"))
        try:
            return self._replies.get(timeout=REPLY_WAIT_S)
        except queue.Empty:
            return b""

    def start_iso(self, handler: PacketHandler) -> None:
        """See KinectTransport."""
        self._handler = handler
        send(self._socket, START)

    def stop_iso(self) -> None:
        """See KinectTransport."""
        with self._handing_over:
            self._handler = None
        send(self._socket, STOP)

    def close(self) -> None:
        """See KinectTransport."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
            self._thread.join(timeout=1.0)
            self._socket.close()

    def _listen(self) -> None:
        try:
            while True:
                kind, body = receive(self._socket)
                if kind == REPLY:
                    self._replies.put(body)
                elif kind == PACKETS:
                    message = decode_packets(body)
                    with self._handing_over:
                        if self._handler is not None:
                            self._handler(*message)
        except DeviceError as error:
            self.failure = str(error)
