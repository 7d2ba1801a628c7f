"""rosbags' readers, kept to limits: what a bag declares is checked before it is unpacked, and no more is unpacked.

A packed chunk holds at least one message, hence an image: its limit is that of a large raw image. What is unpacked of
a bag may be a multiple of its size, so that a bag of many gigabytes streams as it always did. The reader of MCAP, and
that of files and messages packed one by one, take their decompressors from their modules, where these are put;
quality-of-service profiles, YAML inside of YAML that nobody here needs, are not parsed."""

import bz2
import io
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]  # ships no types
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import Chunk, Header, IndexData, RecordType
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2 import storage_mcap, storage_sqlite3

from vsx_ros.limits import MIB, Allowance, file_text, yaml_tree

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZstdError = zstd.ZstdError
MAX_UNPACKED = 64 * MIB  # A packed chunk or message: a colour image of 20 megapixels
_FLOOR, _RATIO = 128 * MIB, 32  # bytes that any bag may unpack to, and times its own size
_PASSES = 4  # Odometry, truth and images are read one after the other


def unpacked(kind: str, data: bytes, most: int) -> bytes:
    """The first bytes, at most so many, of bz2, lz4 or zstd. Raises ValueError, or the library's error."""
    if kind not in ("bz2", "lz4", "zstd"):
        raise ValueError(f"its compression {kind!r} is unknown")
    makers = {"bz2": bz2.BZ2Decompressor, "lz4": lz4.frame.LZ4FrameDecompressor, "zstd": zstd.ZstdDecompressor}
    return bytes(makers[kind]().decompress(data, max_length=most))


def unpacking_of(size: int) -> Allowance:
    """What a bag of a size may be unpacked to, each time it is read from end to end."""
    return Allowance(_FLOOR, size, _RATIO)


def _exactly(kind: str, data: bytes, size: int) -> bytes:
    if size > MAX_UNPACKED:
        raise ValueError(f"a packed chunk says it has {size} bytes, at most {MAX_UNPACKED} can be used")
    content = unpacked(kind, data, size + 1)
    if len(content) != size:
        really = "more" if len(content) > size else "fewer"
        raise ValueError(f"a packed chunk says it has {size} bytes but has {really}")
    return content


def _message(data: bytes) -> bytes:
    content = unpacked("zstd", data, MAX_UNPACKED + 1)
    if len(content) > MAX_UNPACKED:
        raise ValueError(f"a packed message has more than {MAX_UNPACKED} bytes")
    return content


class _File(io.RawIOBase):
    """A packed file, to be read from its beginning to its end."""

    def __init__(self, file: BinaryIO, _mode: str) -> None:
        self._content = zstd.open(file, "rb")
        self._allowance = unpacking_of(file.seek(0, io.SEEK_END))
        file.seek(0)

    def read(self, count: int = -1) -> bytes:
        content: bytes = self._content.read(count if 0 <= count <= MIB else MIB)
        self._allowance.take(len(content), "its packed file")
        return content


class BoundedRos1(Ros1Reader):  # type: ignore[misc]  # to mypy, rosbags is without types
    """Each chunk is unpacked to what it declares; the index is not longer than the file."""

    def open(self) -> None:
        """Raises what rosbags does, ValueError for more than a bag of this size can hold."""
        size = self.path.stat().st_size
        self._declared, self._index_left = unpacking_of(size), size
        self._unpacked = Allowance(_PASSES * _FLOOR, size, _PASSES * _RATIO)
        super().open()

    def read_chunk(self) -> Chunk:
        """As rosbags does, with the size that its header declares."""
        assert self.bio
        at = self.bio.tell()
        header = Header.read(self.bio, RecordType.CHUNK)
        kind, size = header.get_string("compression"), header.get_uint32("size")
        self.bio.seek(at)
        chunk = super().read_chunk()
        if kind == "none":
            return chunk
        self._declared.take(size, "what its chunks hold")

        def decompressed(data: bytes) -> bytes:
            self._unpacked.take(size, "what its chunks hold")
            return _exactly(kind, data, size)

        return chunk._replace(decompressor=decompressed)

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """As rosbags does; an index that several chunks share is none."""
        assert self.bio
        at = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_left -= self.bio.tell() - at
        if self._index_left < 0:
            raise ValueError("its index is longer than the file")


class _Mcap(storage_mcap.McapReader):  # type: ignore[misc]  # as above
    def open(self) -> None:
        """The chunks of one moment are in memory together."""
        super().open()
        size = Path(self.path).stat().st_size
        total, together = unpacking_of(size), Allowance(2 * MAX_UNPACKED, size, 1)
        ends: list[tuple[int, int]] = []
        for chunk in self.chunks:
            total.take(chunk.uncompressed_size, "what its chunks hold")
            ends += [(chunk.message_start_time, chunk.uncompressed_size)]
            ends += [(chunk.message_end_time + 1, -chunk.uncompressed_size)]
        for _, change in sorted(ends):
            together.take(change, "what its chunks of one time hold")


class _Sqlite3(storage_sqlite3.Sqlite3Reader):  # type: ignore[misc]  # as above
    def open(self) -> None:
        """Tables that hold what they hold, and compute nothing."""
        with closing(sqlite3.connect(f"{Path(self.path).absolute().as_uri()}?immutable=1", uri=True)) as base:
            computed = base.execute(
                "SELECT name FROM sqlite_master WHERE type = 'view' OR sql LIKE 'create virtual%' UNION "
                "SELECT m.name FROM sqlite_master AS m, pragma_table_xinfo(m.name) AS c WHERE c.hidden"
            ).fetchone()
        if computed is not None:
            raise ValueError(f"its table {str(computed[0])[:40]!r} is computed, where a bag's hold data")
        super().open()


class _Directory(ros2_reader.DirectoryReader):  # type: ignore[misc]  # as above
    STORAGE_PLUGINS = {"mcap": _Mcap, "sqlite3": _Sqlite3}

    def open(self) -> None:
        """metadata.yaml is not larger than it may be."""
        try:
            yaml_tree(file_text(Path(self.path) / "metadata.yaml"))
        except ValueError as error:
            raise ros2_reader.ReaderError(f"metadata.yaml is none: {error}") from error
        super().open()


class BoundedRos2(Ros2Reader):  # type: ignore[misc]  # as above
    """A folder or a file of its own."""

    STORAGE_PLUGINS = {"dir": _Directory, ".mcap": _Mcap, ".db3": _Sqlite3}


storage_mcap.DECOMPRESSORS.update({kind: lambda d, n, kind=kind: _exactly(kind, d, n) for kind in ("lz4", "zstd")})  # type: ignore[misc]
ros2_reader.zstd = SimpleNamespace(decompress=_message, open=_File)  # type: ignore[assignment]  # as above
for module in (storage_mcap, storage_sqlite3, ros2_reader):
    module.parse_qos = lambda _profiles: []  # type: ignore[attr-defined]  # as above
