"""Several contents in one zip file that ends with its own SHA-256: any tool opens it, and no changed byte goes
unnoticed."""

import hashlib
import io
import zipfile
from collections.abc import Mapping

from vsx_ros.limits import DAMAGE, MIB, Allowance

_SEAL = 64
_ZIP = b"PK\x03\x04"
_FLOOR, _RATIO = 32 * MIB, 4
"""What an archive may unpack to: most of it are pictures and numbers that hardly get smaller."""


def seal(entries: Mapping[str, bytes], *, quick: bool = False) -> bytes:
    """The archive's bytes, the same for the same entries; pictures (.png) are packed as they are, and all else too
    where it shall be quick rather than small."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in entries.items():
            method = zipfile.ZIP_STORED if quick or name.endswith(".png") else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name), content, method, compresslevel=1)
        archive.comment = b"0" * _SEAL
    body = buffer.getbuffer()[:-_SEAL]
    return bytes(body) + hashlib.sha256(body).hexdigest().encode("ascii")


def unseal(content: bytes) -> dict[str, bytes]:
    """The entries of ``seal``. Raises ValueError, saying what is wrong with the bytes."""
    if not content.startswith(_ZIP):
        raise ValueError("it is no sealed archive")
    if hashlib.sha256(memoryview(content)[:-_SEAL]).hexdigest().encode("ascii") != content[-_SEAL:]:
        raise ValueError("its checksum does not fit, it is truncated or was changed")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _unpacked(archive, Allowance(_FLOOR, len(content), _RATIO))
    except (zipfile.BadZipFile, *DAMAGE) as error:  # not ours: zipfile's and zlib's refusals
        raise ValueError(f"it cannot be unpacked ({error})") from error


def _unpacked(archive: zipfile.ZipFile, allowance: Allowance) -> dict[str, bytes]:
    entries: dict[str, bytes] = {}
    for info in archive.infolist():
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{info.filename} is packed in the unknown way {info.compress_type}")
        allowance.take(info.file_size, info.filename)
        with archive.open(info) as file:
            entries[info.filename] = file.read(info.file_size)  # not more than it declares, whatever it holds
        if len(entries[info.filename]) != info.file_size:
            raise ValueError(f"{info.filename} holds fewer bytes than it declares")
    return entries
