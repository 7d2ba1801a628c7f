"""rosbags' readers with limits: the size that a bag declares is checked first, and no more is unpacked.

A packed chunk may hold an image, so its limit is a large raw image. A whole bag may unpack to a multiple of its size,
so that bags of many gigabytes can still be read. The readers of MCAP and of single packed files and messages take their
decompressors from their modules, so they are replaced there. Quality-of-service profiles, YAML inside YAML, are not
needed and not parsed."""

import bz2
import io
import sqlite3
import sys
from contextlib import closing
from functools import partial
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
MAX_UNPACKED = 64 * MIB  # of a packed chunk or message: a colour image of 20 megapixels
_FLOOR, _RATIO = 128 * MIB, 32  # bytes that any bag may unpack to; multiple of its own size
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
        really = "more" if len(content) > size else "fewer"
        raise ValueError(f"a packed chunk says it has {size} bytes but has {really}")
    return content


def _message(data: bytes) -> bytes:
    content = unpacked("zstd", data, MAX_UNPACKED + 1)
    if len(content) > MAX_UNPACKED:
        raise ValueError(f"a packed message has more than {MAX_UNPACKED} bytes")
    return content


class _File(io.RawIOBase):
    """A packed file, read from beginning to end."""

    def __init__(self, file: BinaryIO, _mode: str) -> None:
        self._content = zstd.open(file, "rb")
        self._allowance = unpacking_of(file.seek(0, io.SEEK_END))
        file.seek(0)

    def read(self, count: int = -1) -> bytes:
        content: bytes = self._content.read(count if 0 <= count <= MIB else MIB)
        self._allowance.take(len(content), "its packed file")
        return content


class BoundedRos1(Ros1Reader):  # type: ignore[misc]  # to mypy, rosbags is without types
    """A chunk unpacks exactly to its declared size; the index is not longer than the file."""

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
        self._declared.take(size, "what its chunks hold")

        def decompressed(data: bytes) -> bytes:
            self._unpacked.take(size, "what its chunks hold")
            return _exactly(kind, data, size)

        return chunk._replace(decompressor=decompressed)

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Like rosbags; raises ValueError when several chunks share an index."""
        assert self.bio
        at = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_left -= self.bio.tell() - at
        if self._index_left < 0:
            raise ValueError("its index is longer than the file")


class _Mcap(storage_mcap.McapReader):  # type: ignore[misc]  # as above
    def open(self) -> None:
        """Limits the chunks of the same time together: they are in memory at once."""
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
        """Allows only tables with stored data, not views, virtual tables or computed columns."""
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
        """Checks that metadata.yaml is valid and within its limits."""
        try:
            yaml_tree(file_text(Path(self.path) / "metadata.yaml"))
        except ValueError as error:
            raise ros2_reader.ReaderError(f"metadata.yaml is none: {error}") from error
        super().open()


class BoundedRos2(Ros2Reader):  # type: ignore[misc]  # as above
    """A folder or a single file."""

    STORAGE_PLUGINS = {"dir": _Directory, ".mcap": _Mcap, ".db3": _Sqlite3}


storage_mcap.DECOMPRESSORS.update({kind: partial(_exactly, kind) for kind in ("lz4", "zstd")})
ros2_reader.zstd = SimpleNamespace(decompress=_message, open=_File)  # type: ignore[assignment]  # as above
for module in (storage_mcap, storage_sqlite3, ros2_reader):
    module.parse_qos = lambda _profiles: []  # type: ignore[attr-defined]  # as above
