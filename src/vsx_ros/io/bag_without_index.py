"""Reads ROS 1 bags whose index is missing or wrong, record by record, up to where the file is cut off.

Records are those of the bag format 2.0 (wiki.ros.org/Bags/Format/2.0)."""

import io
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from vsx_ros.io.bounded_rosbags import MAX_UNPACKED, unpacked, unpacking_of
from vsx_ros.limits import DAMAGE

_MESSAGE, _CHUNK, _CONNECTION = _READ = b"\x02", b"\x05", b"\x07"
_MAGIC_BYTES = len(b"#ROSBAG V2.0\n")
_MAX_HEADER_BYTES = 2**20  # rosbag's own headers have some hundred bytes


class UnindexedConnection(NamedTuple):
    """One publisher's messages of a topic; msgtype as in ROS 2, package/msg/Type."""

    id: int
    topic: str
    msgtype: str
    msgcount: int


class UnindexedBag:
    """``connections`` and ``messages`` like rosbags' reader, in the order of the file. Reading ends at a record that is
    cut off; a chunk that cannot be decompressed is left out."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._named: dict[int, tuple[str, str]] = {}
        counts: dict[int, int] = {}
        for number, _, _ in self._walk():
            counts[number] = counts.get(number, 0) + 1
        self.connections = [
            UnindexedConnection(number, *named, counts.get(number, 0)) for number, named in self._named.items()
        ]

    def messages(
        self, connections: Collection[UnindexedConnection]
    ) -> Iterator[tuple[UnindexedConnection, int, bytes]]:
        """(connection, time of recording [ns], serialised message) of the connections."""
        wanted = {connection.id: connection for connection in connections}
        for number, recorded_ns, raw in self._walk():
            if number in wanted:
                yield wanted[number], recorded_ns, raw

    def _walk(self) -> Iterator[tuple[int, int, bytes]]:
        """Yields every whole message of a known connection; stores new connections on the way."""
        size = self._path.stat().st_size
        allowance = unpacking_of(size)
        with self._path.open("rb") as file:
            file.seek(_MAGIC_BYTES)
            for fields, data, whole in _records(file, size):
                if fields.get(b"op") == _CHUNK:
                    inside = _decompressed(fields, data)
                    allowance.take(len(inside), "what its chunks hold")
                    for inner, content, complete in _records(io.BytesIO(inside), len(inside)):
                        if complete:
                            yield from self._message(inner, content)
                elif whole:
                    yield from self._message(fields, data)

    def _message(self, fields: dict[bytes, bytes], data: bytes) -> Iterator[tuple[int, int, bytes]]:
        number = int.from_bytes(fields.get(b"conn", b"")[:4], "little")
        if fields.get(b"op") == _CONNECTION:
            kind = _fields(data).get(b"type", b"").decode(errors="replace")
            topic = fields.get(b"topic", b"").decode(errors="replace")
            self._named.setdefault(number, (topic, kind.replace("/", "/msg/")))
        elif fields.get(b"op") == _MESSAGE and number in self._named:
            time = fields.get(b"time", bytes(8))
            seconds, rest = int.from_bytes(time[:4], "little"), int.from_bytes(time[4:8], "little")
            yield number, seconds * 1_000_000_000 + rest, data


def _records(stream: BinaryIO, end: int) -> Iterator[tuple[dict[bytes, bytes], bytes, bool]]:
    """(header, data, whether the data is complete) until the stream ends or is invalid."""
    while True:
        header_bytes = int.from_bytes(stream.read(4), "little")
        if not 0 < header_bytes <= min(_MAX_HEADER_BYTES, end - stream.tell() - 4):
            return
        fields = _fields(stream.read(header_bytes))
        data_bytes = int.from_bytes(stream.read(4), "little")
        left = end - stream.tell()
        if fields.get(b"op") in _READ:
            yield fields, stream.read(min(data_bytes, left)), data_bytes <= left
        else:
            stream.seek(data_bytes, io.SEEK_CUR)
        if data_bytes > left:
            return


def _fields(header: bytes) -> dict[bytes, bytes]:
    """name=value pairs, each after its length."""
    fields, position = {}, 0
    while position + 4 <= len(header):
        length = int.from_bytes(header[position : position + 4], "little")
        name, _, value = header[position + 4 : position + 4 + length].partition(b"=")
        fields[name] = value
        position += 4 + length
    return fields


def _decompressed(fields: dict[bytes, bytes], data: bytes) -> bytes:
    """The readable part of a chunk, which may be cut short."""
    declared = int.from_bytes(fields.get(b"size", b"")[:4], "little")
    try:
        kind = fields.get(b"compression", b"").decode("ascii")
        return data if kind == "none" else unpacked(kind, data, min(declared, MAX_UNPACKED))
    except DAMAGE:
        return b""
