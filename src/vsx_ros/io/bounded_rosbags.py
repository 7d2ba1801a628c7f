"""rosbags' readers with limits: the size that a bag declares is checked first, and no more is unpacked.

A packed chunk may hold an image, so its limit is a large raw image. One after the other is in memory, so a whole bag
may unpack to gigabytes, as simulated images of plain colour do: the limit of a bag is one of time. The readers of MCAP
and of single packed files and messages take their decompressors from their modules, so they are replaced there.
Quality-of-service profiles, YAML inside YAML, are not needed and not parsed.

In place of the bytes of a message that cannot be read, ``messages`` of all readers give why, an exception."""

import bz2
import heapq
import io
import sqlite3
import sys
from collections.abc import Collection, Iterator
from contextlib import closing
from functools import partial
from itertools import repeat
from operator import methodcaller
from pathlib import Path
from shutil import disk_usage
from tempfile import gettempdir
from types import SimpleNamespace
from typing import Any, BinaryIO

import apsw
import lz4.frame  # type: ignore[import-untyped]  # ships no types
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag1.reader import Chunk, Header, IndexData, RecordType, read_bytes, read_uint32
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import ReaderError as Ros2ReaderError
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2 import storage_mcap, storage_sqlite3

from vsx_ros.limits import DAMAGE, MIB, Allowance, OverLimitError, file_text, yaml_tree

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZstdError = zstd.ZstdError
_UNREADABLE = (Ros1ReaderError, Ros2ReaderError, ZstdError, *DAMAGE)
MAX_UNPACKED = 64 * MIB  # of a packed chunk or message: a colour image of 20 megapixels
_MOST_RECORD = 2 * MAX_UNPACKED  # bytes of a record as it is stored: of MCAP, or a row
_FLOOR, _RATIO = 256 * MIB, 512  # bytes that any bag may unpack to, some seconds of work; multiple of its size
_PASSES = 4  # odometry, truth and stamps of images are read one after the other


def unpacked(kind: str, data: bytes, most: int) -> bytes:
    """The first bytes, at most ``most``, of bz2, lz4 or zstd. Raises ValueError, or the library's error."""
    if kind not in ("bz2", "lz4", "zstd"):
        raise ValueError(f"its compression {kind!r} is unknown")
    makers = {"bz2": bz2.BZ2Decompressor, "lz4": lz4.frame.LZ4FrameDecompressor, "zstd": zstd.ZstdDecompressor}
    return bytes(makers[kind]().decompress(data, max_length=most))


def unpacking_of(size: int) -> Allowance:
    """The number of bytes that a bag of this size may unpack to, each time it is read."""
    return Allowance(_FLOOR, size, _RATIO)


def _exactly(kind: str, data: bytes, size: int) -> bytes:
    if size > MAX_UNPACKED:
        raise ValueError(f"a packed chunk says it has {size} bytes, at most {MAX_UNPACKED} can be used")
    content = unpacked(kind, data, size + 1)
    if len(content) != size:
        raise ValueError(f"a packed chunk says it has {size} bytes, which is not true")
    return content


def _message(data: bytes) -> bytes | Exception:
    try:
        content = unpacked("zstd", data, MAX_UNPACKED + 1)
    except _UNREADABLE as error:
        return error
    too_large = len(content) > MAX_UNPACKED
    return ValueError(f"a packed message has more than {MAX_UNPACKED} bytes") if too_large else content


class _File(io.RawIOBase):
    """A packed file, read from beginning to end. rosbags unpacks it to the disk: half the free space may be taken."""

    def __init__(self, file: BinaryIO, _mode: str) -> None:
        self._content, self._allowed = zstd.open(file, "rb"), unpacking_of(Path(file.name).stat().st_size)
        self._left = disk_usage(gettempdir()).free // 2

    def read(self, count: int = -1) -> bytes:
        content: bytes = self._content.read(count if 0 <= count <= MIB else MIB)
        self._allowed.take(len(content), "its packed file")
        self._left -= len(content)
        if self._left < 0:
            raise OverLimitError(f"its packed file takes more than half of what is free in {gettempdir()}, see TMPDIR")
        return content


class BoundedRos1(Ros1Reader):  # type: ignore[misc]  # to mypy, rosbags is without types
    """A chunk unpacks exactly to its declared size; the index is not longer than the file."""

    current_chunk: tuple[int, BinaryIO]

    def open(self) -> None:
        """Raises rosbags' errors, and ValueError for more than a bag of this size can hold."""
        size = self.path.stat().st_size
        self._declared, self._index_left = unpacking_of(size), size
        self._unpacked = Allowance(_PASSES * _FLOOR, size, _PASSES * _RATIO)
        super().open()

    def read_chunk(self) -> Chunk:
        """Like rosbags, but limited to the size that the chunk's header declares."""
        assert self.bio
        at = self.bio.tell()
        header = Header.read(self.bio, RecordType.CHUNK)
        kind, size = header.get_string("compression"), header.get_uint32("size")
        self.bio.seek(at)
        chunk = super().read_chunk()
        if kind == "none":
            return chunk
        used = min(size, MAX_UNPACKED)
        self._declared.take(used, "what its chunks hold")

        def decompressed(data: bytes) -> bytes:
            self._unpacked.take(used, "what its chunks hold")
            return _exactly(kind, data, size)

        return chunk._replace(decompressor=decompressed)

    def messages(self, connections: Collection[Any]) -> Iterator[tuple[Any, int, bytes | Exception]]:
        """By time, as rosbags."""
        indexes = [zip(self.indexes[connection.id], repeat(connection)) for connection in connections]
        for entry, connection in heapq.merge(*indexes, key=lambda pair: pair[0].time):
            try:
                raw: bytes | Exception = self._message(entry)
            except OverLimitError:
                raise
            except _UNREADABLE as error:
                raw = error
            yield connection, entry.time, raw

    def _message(self, entry: IndexData) -> bytes:
        if self.current_chunk[0] != entry.chunk_pos:
            assert self.bio
            self.current_chunk = entry.chunk_pos, io.BytesIO()  # what cannot be unpacked is tried once
            chunk = self.chunks[entry.chunk_pos]
            self.bio.seek(chunk.datapos)
            packed = read_bytes(self.bio, chunk.datasize)
            self.current_chunk = entry.chunk_pos, io.BytesIO(chunk.decompressor(packed))
        inside = self.current_chunk[1]
        inside.seek(entry.offset)
        while (header := Header.read(inside)).get_uint8("op") == RecordType.CONNECTION:
            inside.seek(read_uint32(inside), io.SEEK_CUR)
        if header.get_uint8("op") != RecordType.MSGDATA or header.get_time("time") != entry.time:
            raise ValueError("its record is another than its index says")
        return bytes(read_bytes(inside, read_uint32(inside)))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Like rosbags; raises ValueError when several chunks share an index."""
        assert self.bio
        at = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_left -= self.bio.tell() - at
        if self._index_left < 0:
            raise ValueError("its index is longer than the file")


def _read_exact(file: BinaryIO, size: int) -> bytes:
    if size > _MOST_RECORD:
        at = file.tell()
        if size > file.seek(0, io.SEEK_END) - at:
            raise EOFError(f"a record of {size} bytes is cut off")
        raise OverLimitError(f"a record has {size} bytes, at most {_MOST_RECORD} can be used")
    return bytes(_read_whole(file, size))


def _of_chunk(
    chunk: storage_mcap.ChunkInfo, wanted: dict[int, Any], start: int, stop: int, file: BinaryIO
) -> Iterator[storage_mcap.Msg]:
    try:
        yield from _of_whole_chunk(chunk, wanted, start, stop, file)
    except _UNREADABLE as error:
        for number in wanted:
            lost = storage_mcap.Msg(chunk.message_end_time, chunk.chunk_start_offset, wanted[number], error)
            yield from repeat(lost, chunk.channel_count.get(number, 0))


class _Mcap(storage_mcap.McapReader):  # type: ignore[misc]  # as above
    def open(self) -> None:
        """Limits the chunks of the same time together: they are in memory at once."""
        super().open()
        size = Path(self.path).stat().st_size
        total, together = unpacking_of(size), Allowance(_MOST_RECORD, size, 1)
        ends: list[tuple[int, int]] = []
        left = size // 16  # bytes of an index entry; each message has one, also those of a damaged chunk
        for chunk in self.chunks:
            for number, count in chunk.channel_count.items():
                chunk.channel_count[number] = min(max(count, 1), max(left, 1))
                left -= chunk.channel_count[number]
            used = min(chunk.uncompressed_size, _MOST_RECORD)
            total.take(used, "what its chunks hold")
            ends += [(chunk.message_start_time, used), (chunk.message_end_time + 1, -used)]
        for _, change in sorted(ends):
            together.take(change, "what its chunks of one time hold")


class _Sqlite3(storage_sqlite3.Sqlite3Reader):  # type: ignore[misc]  # as above
    def open(self) -> None:
        """Allows only tables with stored data, not views, virtual tables or computed columns."""
        with closing(sqlite3.connect(f"{Path(self.path).absolute().as_uri()}?immutable=1", uri=True)) as base:
            computed = base.execute(
                "SELECT name FROM sqlite_master WHERE type = 'view' OR sql LIKE 'create virtual%' UNION "
                "SELECT m.name FROM sqlite_master AS m, pragma_table_xinfo(m.name) AS c WHERE c.hidden"
            ).fetchone()
        if computed is not None:
            raise ValueError(f"its table {str(computed[0])[:40]!r} is computed, where a bag's hold data")
        super().open()

    def messages(self, *args: Any) -> Iterator[tuple[Any, int, bytes]]:
        """Like rosbags; raises OverLimitError at a message that would take too much memory."""
        try:
            yield from super().messages(*args)
        except apsw.TooBigError as error:
            raise OverLimitError(f"a message has more than {_MOST_RECORD} bytes") from error


class _Directory(ros2_reader.DirectoryReader):  # type: ignore[misc]  # as above
    STORAGE_PLUGINS = {"mcap": _Mcap, "sqlite3": _Sqlite3}

    def open(self) -> None:
        """Checks that metadata.yaml is valid and within its limits."""
        try:
            yaml_tree(file_text(Path(self.path) / "metadata.yaml"))
        except ValueError as error:
            raise ros2_reader.ReaderError(f"metadata.yaml is none: {error}") from error
        super().open()


class BoundedRos2(Ros2Reader):  # type: ignore[misc]  # as above
    """A folder or a single file."""

    STORAGE_PLUGINS = {"dir": _Directory, ".mcap": _Mcap, ".db3": _Sqlite3}


apsw.connection_hooks.append(methodcaller("limit", apsw.SQLITE_LIMIT_LENGTH, _MOST_RECORD))
_of_whole_chunk, storage_mcap.msgsrc = storage_mcap.msgsrc, _of_chunk
_read_whole, storage_mcap.read_exact = storage_mcap.read_exact, _read_exact
storage_mcap.DECOMPRESSORS.update({kind: partial(_exactly, kind) for kind in ("lz4", "zstd")})
ros2_reader.zstd = SimpleNamespace(decompress=_message, open=_File)  # type: ignore[assignment]  # as above
for module in (storage_mcap, storage_sqlite3, ros2_reader):
    module.parse_qos = lambda _profiles: []  # type: ignore[attr-defined]  # as above
