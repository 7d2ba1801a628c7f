"""The emulated USB cable: messages over a Unix stream socket between a driver and an emulated Kinect.

``kind, length, body``. Kinds from the driver: O control out, I control in, S start and X stop receiving packets.
From the camera: R reply to I, P packets: i64 bus time [ns], then per packet u16 length and its bytes.
The bus time is when the packets would have been on the wire: what a host controller knows as the frame number. An
emulated image is rendered after its exposure, so its arrival on the socket says nothing about its age.
"""

import socket
import struct

import numpy as np
from numpy.typing import NDArray

from vsx_hw.errors import DeviceError, ProtocolError
from vsx_hw.kinect.protocol import PACKET_BYTES

CONTROL_OUT, CONTROL_IN, START, STOP, REPLY, PACKETS = b"O", b"I", b"S", b"X", b"R", b"P"
_HEAD = struct.Struct("<cI")
_LONGEST_BODY = 1 << 20


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
    data = bytearray(count)
    view = memoryview(data)
    at = 0
    while at < count:
        try:
            got = connection.recv_into(view[at:])
        except OSError as error:
            raise DeviceError(f"emulated Kinect: connection lost ({error})") from error
        if not got:
            raise DeviceError("emulated Kinect: unplugged")
        at += got
    return bytes(data)


def encode_packets(bus_time_ns: int, packets: NDArray[np.uint8], lengths: NDArray[np.int64]) -> bytes:
    """The body of a P message."""
    head = struct.pack("<qH", bus_time_ns, len(lengths)) + lengths.astype("<u2").tobytes()
    return head + b"".join(packet[:length].tobytes() for packet, length in zip(packets, lengths))


def decode_packets(body: bytes) -> tuple[int, NDArray[np.uint8], NDArray[np.int64]]:
    """(bus time [ns], packets (N, 1920), lengths (N,)). Raises ProtocolError when the sizes disagree."""
    if len(body) < 10:
        raise ProtocolError(f"emulated Kinect: packet message of {len(body)} bytes")
    bus_time_ns, count = struct.unpack_from("<qH", body)
    lengths = np.frombuffer(body, "<u2", min(count, (len(body) - 10) // 2), 10).astype(np.int64)
    data = np.frombuffer(body, np.uint8, -1, 10 + 2 * len(lengths))
    if len(lengths) != count or int(lengths.sum()) != len(data) or (lengths > PACKET_BYTES).any():
        raise ProtocolError("emulated Kinect: packet lengths do not add up to the message")
    packets = np.zeros((count, PACKET_BYTES), np.uint8)
    ends = np.cumsum(lengths)
    for row, end, length in zip(packets, ends, lengths):
        row[:length] = data[end - length : end]
    return bus_time_ns, packets, lengths
