"""Random damage to files: bytes, numbers, lines, and parts of each format with corrected checksums, so that the damage
reaches the reader behind them."""

import bz2
import io
import random
import re
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import lz4.frame
import numpy as np

from vsx_ros.io.sealed_archive import array_bytes, array_of, seal, unseal

Mutation = Callable[[random.Random, bytes], bytes]

WIDTHS = {1: "B", 2: "H", 4: "I", 8: "Q"}
WORDS = (
    b"nan", b"-nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"-0.0", b"1e308", b"5e-324", b"2147483648", b"1e30",
    b"9223372036854775808", b"18446744073709551616", b"9" * 400, b"9" * 5000, b"null", b"true", b"[]", b"{}", b'""',
    b'"x"', b"[[[]]]", b"{a: 1}", b"*a", b"&a x", b"!!int x", b"!!timestamp x", b"!!python/object:os.system x",
    b"1:1:1", b"2001-99-99", b"\xff\xfe", b"\x00", "\u2028".encode(), b"<<", b"? x", b"|", b"P5", b"P6", b"65536 65536",
    b"x" * 200, b"[" * 3000, b'{"a":' * 3000, b"0x7fffffff", b"1_0", b"..", b"../..", b"/dev/zero", b"\n", b",", b";",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_TOKEN = re.compile(rb"[^\s,:\[\]{}\"]+")


def integer(rng: random.Random, bits: int) -> int:
    """A number that often breaks readers."""
    edge = 1 << rng.choice((0, 7, 8, 15, 16, 24, 26, 30, 31, 32, 40, 62, 63))
    return rng.choice((0, 1, edge, edge - 1, edge + 1, -edge, -1, rng.getrandbits(bits))) % (1 << bits)


def raw(rng: random.Random, data: bytes) -> bytes:
    """Flip, lose, double, insert or cut off bytes, or replace numbers."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5, 20))):
        at, kind = rng.randrange(len(changed) + 1), rng.randrange(7)
        if kind == 0 and at < len(changed):
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            width = rng.choice((1, 2, 4, 8))
            changed[at : at + width] = integer(rng, 8 * width).to_bytes(width, rng.choice(("little", "big")))
        elif kind == 2:
            del changed[at : at + rng.choice((1, 4, 16, 300))]
        elif kind == 3:
            changed[at:at] = changed[at : at + rng.choice((1, 8, 100, 1000))]
        elif kind == 4:
            changed[at:at] = rng.randbytes(rng.choice((1, 3, 30)))
        elif kind == 5 and rng.random() < 0.3:
            del changed[at:]
        else:
            changed[at : at + 1] = rng.choice(WORDS)
    return bytes(changed)


def text(rng: random.Random, data: bytes) -> bytes:
    """Replace numbers and words; lose, double, exchange or indent lines."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        kind = rng.randrange(6)
        if kind < 3:
            found = list((_NUMBER if kind else _TOKEN).finditer(data))
            if found:
                one = rng.choice(found)
                data = data[: one.start()] + rng.choice(WORDS) + data[one.end() :]
            continue
        lines = data.split(b"\n")
        at = rng.randrange(len(lines))
        if kind == 3:
            del lines[at]
        elif kind == 4:
            lines[at:at] = [lines[rng.randrange(len(lines))]] * rng.choice((1, 2, 50))
        else:
            lines[at] = rng.choice((b"  ", b"- ", b"\t", b"? ", b"&a ", b"- *a\n", b"")) + lines[at][rng.randrange(3) :]
        data = b"\n".join(lines)
    return data


def array(rng: random.Random, data: bytes) -> bytes:
    """Change header, type, shape or some numbers of a .npy file."""
    kind = rng.randrange(6)
    if kind == 0:
        return text(rng, data)
    if kind == 1:
        return raw(rng, data)
    with suppress(ValueError):
        values = array_of(data)
        if kind == 2 and values.size:
            flat = values.reshape(-1)
            with suppress(OverflowError):
                flat[rng.randrange(flat.size)] = rng.choice((0, -1, 1, 2**31, 2**62, -(2**62), 1e300, np.nan, 7))
        elif kind == 3:
            values = values[: rng.randrange(len(values) + 1)]
        elif kind == 4:
            values = np.concatenate([values] * rng.choice((2, 3)))
        else:
            values = np.asarray(values, rng.choice(("<f4", "<f8", "<i8", ">i8", "|u1", "|S3", "<c16", "|b1")))
        return array_bytes(values)
    return data


def sealed(rng: random.Random, data: bytes) -> bytes:
    """Change an entry of a sealed archive, or the archive's own bytes with a correct seal."""
    if rng.random() < 0.3:
        body = bytearray(raw(rng, data[:-64]))
        return _resealed(bytes(body))
    entries = unseal(data)
    name = rng.choice(list(entries))
    kind = rng.randrange(8)
    if kind == 0:
        del entries[name]
    elif kind == 1:
        entries[rng.choice(list(entries))] = entries[name]
    else:
        change = {"npy": array, "json": text, "png": png, "jpg": jpeg}[name.rpartition(".")[2]]
        entries[name] = change(rng, entries[name])
    if kind == 2:
        return _lying(rng, entries)
    return seal(entries, quick=rng.random() < 0.5)


def _resealed(body: bytes) -> bytes:
    import hashlib

    return body + hashlib.sha256(body).hexdigest().encode()


def _lying(rng: random.Random, entries: dict[str, bytes]) -> bytes:
    """Wrong sizes in the zip's directory, or another compression method."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(
        buffer, "w", rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    ) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
        archive.comment = b"0" * 64
    body = bytearray(buffer.getvalue()[:-64])
    at = body.find(b"PK\x01\x02", rng.randrange(len(body)))
    if at >= 0:
        struct.pack_into("<I", body, at + rng.choice((16, 20, 24, 42)), integer(rng, 32))
    return _resealed(bytes(body))


def png(rng: random.Random, data: bytes) -> bytes:
    """Change, lose or double a chunk of a PNG, with a correct checksum."""
    at, chunks = 8, []
    while at + 12 <= len(data):
        (size,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    if not chunks or rng.random() < 0.2:
        return raw(rng, data)
    k = rng.randrange(len(chunks))
    kind, content = chunks[k]
    if kind == b"IHDR" and rng.random() < 0.7 and len(content) == 13:
        fields = list(struct.unpack(">IIBBBBB", content))
        which = rng.randrange(7)
        fields[which] = integer(rng, 32 if which < 2 else 8)
        content = struct.pack(">IIBBBBB", *fields)
    elif kind == b"IDAT" and rng.random() < 0.5:
        with suppress(zlib.error):
            content = zlib.compress(raw(rng, zlib.decompress(content)) * rng.choice((1, 1, 50)))
    else:
        content = raw(rng, content)
    chunks[k : k + 1] = [(kind, content)] * rng.choice((1, 1, 1, 0, 2))
    body = [struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks]
    return data[:8] + b"".join(body)


def jpeg(rng: random.Random, data: bytes) -> bytes:
    """Change, lose or double a segment of a JPEG, with its correct length."""
    at, segments = 2, []
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (size,) = struct.unpack_from(">H", data, at + 2)
        segments.append((data[at : at + 2], data[at + 4 : at + 2 + size]))
        at += 2 + size
    if not segments or rng.random() < 0.2:
        return raw(rng, data)
    k = rng.randrange(len(segments))
    kind, content = segments[k]
    if kind == b"\xff\xc0" and rng.random() < 0.7 and len(content) >= 6:
        depth, *size, colours = struct.unpack(">BHHB", content[:6])
        size[rng.randrange(2)] = integer(rng, 16)
        content = struct.pack(">BHHB", depth, *size, colours) + content[6:]
    else:
        content = raw(rng, content)[:65533]
    segments[k : k + 1] = [(kind, content)] * rng.choice((1, 1, 1, 0, 2))
    return data[:2] + b"".join(k + struct.pack(">H", len(c) + 2) + c for k, c in segments) + data[at:]


def tiff(rng: random.Random, data: bytes) -> bytes:
    """Change, lose or double tags of a TIFF, in a directory at its end; all other places stay correct. Numbers of eight
    bytes are stored where their tag says."""
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    tags = [list(struct.unpack_from(f"{order}HHII", data, at + 2 + 12 * k)) for k in range(count)]
    if not tags or rng.random() < 0.2:
        return raw(rng, data)
    data += bytes(len(data) % 2)
    for _ in range(rng.choice((1, 1, 2, 5))):
        k = rng.randrange(len(tags))
        kind = rng.randrange(6)
        if kind == 0:
            tags.insert(k + rng.randrange(2), [*tags[k][:3], integer(rng, 32)])
        elif kind == 1:
            tags[k][1:] = [rng.choice((16, 17, 13, 5, 12)), 1, len(data)]
            data += struct.pack(f"{order}Q", integer(rng, 64))
        elif kind == 2:
            tags[k][1] = rng.randrange(19)
        elif kind == 3 and len(tags) > 1:
            del tags[k]
        elif kind == 4:
            tags[k][0] = rng.choice((256, 257, 258, 274, 277, 278, 322, 323, 338))
        else:
            tags[k][rng.choice((2, 3, 3))] = integer(rng, 32) & rng.choice((0xFFFF, 0xFFFFFFFF))
    body = b"".join(struct.pack(f"{order}HHII", *tag) for tag in tags)
    place = struct.pack(f"{order}I", len(data))
    return data[:4] + place + data[8:] + struct.pack(f"{order}H", len(tags)) + body + bytes(4)


def ros1_bag(rng: random.Random, data: bytes) -> bytes:
    """Change a field or the content of a record; content of a chunk before compression."""
    if rng.random() < 0.25:
        return raw(rng, data)
    records = list(_ros1_records(data, 13))
    begin, fields, content, end = rng.choice(records)
    kind = rng.randrange(4)
    if kind == 0 and fields:
        name = rng.choice(list(fields))
        fields[name] = rng.choice((raw(rng, fields[name]), integer(rng, 32).to_bytes(4, "little"), b"bz2", b"lz4"))
    elif b"compression" in fields:
        content = _chunk(rng, fields, content)
    else:
        content = raw(rng, content)
    header = b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n + b"=" + v for n, v in fields.items())
    size = integer(rng, 32) if rng.random() < 0.1 else len(content)
    record = struct.pack("<I", len(header)) + header + struct.pack("<I", size) + content
    changed = data[:begin] + record + data[end:]
    if rng.random() < 0.7 and b"index_pos" not in fields:
        (index,) = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)
        if index > begin:
            at = data.index(b"index_pos=") + 10
            changed = changed[:at] + struct.pack("<Q", index + len(changed) - len(data)) + changed[at + 8 :]
    return changed


def _chunk(rng: random.Random, fields: dict[bytes, bytes], content: bytes) -> bytes:
    how = fields[b"compression"]
    unpack = {b"bz2": bz2.decompress, b"lz4": lz4.frame.decompress}.get(how, bytes)
    pack = {b"bz2": bz2.compress, b"lz4": lz4.frame.compress}.get(how, bytes)
    inside = unpack(content)
    if rng.random() < 0.5:
        begin, _, message, end = rng.choice(list(_ros1_records(inside, 0)))
        inside = (
            inside[: end - len(message)] + raw(rng, message)[: len(message)].ljust(len(message), b"\0") + inside[end:]
        )
    else:
        inside = raw(rng, inside)
    if rng.random() < 0.8:
        fields[b"size"] = struct.pack("<I", len(inside))
    return pack(inside)


def _ros1_records(data: bytes, at: int):
    while at + 8 <= len(data):
        begin = at
        (size,) = struct.unpack_from("<I", data, at)
        fields, end = {}, at + 4 + size
        at += 4
        while at < end:
            (length,) = struct.unpack_from("<I", data, at)
            name, _, value = data[at + 4 : at + 4 + length].partition(b"=")
            fields[name] = value
            at += 4 + length
        (size,) = struct.unpack_from("<I", data, at)
        yield begin, fields, data[at + 4 : at + 4 + size], at + 4 + size
        at += 4 + size


def mcap(rng: random.Random, data: bytes) -> bytes:
    """Change the content of a record, or its length."""
    if rng.random() < 0.25:
        return raw(rng, data)
    at, records = 8, []
    while at + 9 <= len(data) - 8:
        (size,) = struct.unpack_from("<Q", data, at + 1)
        records.append((at, data[at], data[at + 9 : at + 9 + size]))
        at += 9 + size
    at, kind, content = rng.choice(records)
    changed = raw(rng, content)
    if rng.random() < 0.7:  # all other offsets stay correct
        changed = changed[: len(content)].ljust(len(content), b"\0")
    size = integer(rng, 64) if rng.random() < 0.1 else len(changed)
    return data[:at] + bytes([kind]) + struct.pack("<Q", size) + changed + data[at + 9 + len(content) :]


def database(rng: random.Random, path: Path) -> None:
    """Change a cell, a table or the bytes of an sqlite3 file."""
    if rng.random() < 0.4:
        path.write_bytes(raw(rng, path.read_bytes()))
        return
    with closing(sqlite3.connect(path)) as base, suppress(sqlite3.Error, OverflowError):
        table = rng.choice([row[0] for row in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")])
        column = rng.choice([row[1] for row in base.execute(f"PRAGMA table_info({table})")])
        (row, value) = rng.choice(list(base.execute(f"SELECT rowid, {column} FROM {table}")))
        if isinstance(value, bytes):
            value = raw(rng, value)
        else:
            value = rng.choice((None, -1, 2**40, 1e300, "x", b"\xff", "a" * 5000, "sensor_msgs/msg/Image", "", "cdr"))
        statement = rng.choice(
            (f"UPDATE {table} SET {column} = ? WHERE rowid = {row}", f"UPDATE {table} SET {column} = ?")
        )
        base.execute(statement, (value,))
        if rng.random() < 0.1:
            base.execute(
                rng.choice((f"DELETE FROM {table}", f"DROP TABLE {table}", f"ALTER TABLE {table} RENAME TO x"))
            )
        base.commit()
