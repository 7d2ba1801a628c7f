"""Files in which every changed byte is detected: a zip file that ends with its own SHA-256 and that any zip tool opens;
and large arrays whose rows mostly never change, stored in pieces that are written once."""

import hashlib
import io
import math
import tokenize
import zipfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vsx_ros.errors import reason_of
from vsx_ros.io.atomic import write_bytes
from vsx_ros.limits import DAMAGE, DATA_BYTES, MIB, Allowance, file_bytes

_SEAL = 64  # hexadecimal digits of SHA-256
_ZIP = b"PK\x03\x04"
_FLOOR, _RATIO = 32 * MIB, 4
"""Limits of what an archive may unpack to: most of it is images and numbers that hardly compress. What compresses
better is stored before a limit is reached. Pieces of arrays may be used more than once: those of culled keyframes are
empty and so identical."""


def seal_into(file: BinaryIO, entries: Iterable[tuple[str, bytes]], *, quick: bool = False) -> None:
    """Write an archive to an empty file, one entry after the other; the same bytes for the same entries. Images are
    stored uncompressed, and so is what could be refused when it is unpacked. quick: so is the rest, for speed."""
    allowed = _FLOOR  # bytes that an entry may unpack to, however small it becomes
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in entries:
            stored = quick or name.endswith((".png", ".jpg")) or len(content) > allowed
            info = zipfile.ZipInfo(name)
            archive.writestr(info, content, zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED, compresslevel=1)
            allowed += _RATIO * info.compress_size - len(content)
        archive.comment = b"0" * _SEAL
    left = file.tell() - _SEAL
    file.seek(0)
    digest = hashlib.sha256()
    while left:
        piece = file.read(min(left, MIB))
        digest.update(piece)
        left -= len(piece)
    file.seek(file.tell())  # from reading to writing
    file.write(digest.hexdigest().encode("ascii"))


def seal(entries: Mapping[str, bytes], *, quick: bool = False) -> bytes:
    """The archive's bytes."""
    buffer = io.BytesIO()
    seal_into(buffer, entries.items(), quick=quick)
    return buffer.getvalue()


def unseal(content: bytes) -> dict[str, bytes]:
    """The entries of ``seal``. Raises ValueError with the reason if the bytes are wrong."""
    if not content.startswith(_ZIP):
        raise ValueError("it is no sealed archive")
    if hashlib.sha256(memoryview(content)[:-_SEAL]).hexdigest().encode("ascii") != content[-_SEAL:]:
        raise ValueError("its checksum does not fit, it is truncated or was changed")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _unpacked(archive, Allowance(_FLOOR, len(content), _RATIO))
    except (zipfile.BadZipFile, *DAMAGE) as error:  # from zipfile and zlib
        raise ValueError(f"it cannot be unpacked ({error})") from error


def glance(path: Path, name: str) -> bytes:
    """One entry of an archive, by its own checksum: the seal would need the whole file. Raises ValueError."""
    try:
        with zipfile.ZipFile(path) as archive:
            return _entry(archive, archive.getinfo(name), Allowance(_FLOOR, path.stat().st_size, _RATIO))
    except (zipfile.BadZipFile, *DAMAGE) as error:
        raise ValueError(f"{name} cannot be unpacked ({error})") from error


def _unpacked(archive: zipfile.ZipFile, allowance: Allowance) -> dict[str, bytes]:
    return {info.filename: _entry(archive, info, allowance) for info in archive.infolist()}


def _entry(archive: zipfile.ZipFile, info: zipfile.ZipInfo, allowance: Allowance) -> bytes:
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{info.filename} is packed in the unknown way {info.compress_type}")
    allowance.take(info.file_size, info.filename)
    with archive.open(info) as file:
        content = file.read(info.file_size)  # not more than it declares
    if len(content) != info.file_size:
        raise ValueError(f"{info.filename} holds fewer bytes than it declares")
    return content


class ArrayChunks:
    """A folder of .npy files, each named by the SHA-256 of its content, so equal pieces are one file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, array: NDArray[Any], cuts: Sequence[int] | NDArray[np.int64]) -> list[str]:
        """Write the new pieces of an array to the disk. cuts: the rows that begin another piece, ascending. Returns the
        names of all its pieces, in order. Raises OSError."""
        self.path.mkdir(parents=True, exist_ok=True)
        names = []
        for content in map(array_bytes, np.split(array, cuts)):
            names.append(hashlib.sha256(content).hexdigest())
            path = self.path / f"{names[-1]}.npy"
            if not path.exists():
                write_bytes(path, content, durable=True)
        return names

    def read(self, names: Sequence[str], allowance: Allowance) -> NDArray[Any]:
        """The array of these pieces. Raises OSError if one is missing, ValueError if one was changed, or if pieces are
        used so often that the allowance is exceeded."""
        pieces = []
        for name in names:
            content = file_bytes(self.path / f"{Path(name).name}.npy", DATA_BYTES)
            if hashlib.sha256(content).hexdigest() != name:
                raise ValueError(f"its piece {name}.npy was changed")
            allowance.take(len(content), f"piece {name}.npy")
            pieces.append(array_of(content))
        return np.concatenate(pieces)

    def allowance(self) -> Allowance:
        """The allowance for reading a map, of which few pieces are equal. Raises OSError."""
        there = list(self.path.iterdir()) if self.path.exists() else []
        return Allowance(_FLOOR, sum(path.stat().st_size for path in there), 1)

    def keep(self, names: Collection[str]) -> None:
        """Delete all other pieces. Raises OSError."""
        kept = {f"{name}.npy" for name in names}
        for path in self.path.iterdir():
            if path.name not in kept:
                path.unlink()


def array_bytes(array: NDArray[Any]) -> bytes:
    """An array as the content of a .npy file."""
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return content.getvalue()


def array_of(content: bytes) -> NDArray[Any]:
    """The array of a .npy file. Raises ValueError for anything else, and if its header declares another size."""
    file = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(file)
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, by_column, dtype = read_header[version](file)
    except (tokenize.TokenError, *DAMAGE) as error:  # its header is a Python expression
        raise ValueError(f"it holds no array ({reason_of(error)})") from error
    size, held = math.prod(shape) * dtype.itemsize, len(content) - file.tell()
    if dtype.hasobject or min(shape, default=0) < 0 or size != held:
        raise ValueError(f"an array of {dtype} and shape {shape} does not fit {held} bytes")
    array = np.frombuffer(content, dtype, math.prod(shape), file.tell())
    return array.reshape(shape, order="F" if by_column else "C").copy()
