"""Small files that ask for gigabytes, or for more than Python's stack: what each reader must refuse at once."""

import bz2
import hashlib
import io
import json
import sqlite3
import struct
import zipfile
import zlib
from contextlib import closing
from functools import cache

import lz4.frame
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from vsx_ros.io.sealed_archive import array_bytes, seal, unseal
from vsx_ros.io.slam_map_arrays import LAYOUT

GIB = 2**30
DEEP = 100_000
ZEROS = bytes(2**24)
PLACE = 8  # in a TIFF


@cache
def deflated(size):
    """So many zero bytes by deflate, one piece of them again and again."""
    packer = zlib.compressobj(1, zlib.DEFLATED, -15)
    return (packer.compress(ZEROS) + packer.flush(zlib.Z_FULL_FLUSH)) * (size // len(ZEROS)) + b"\x03\x00"


def zlib_zeros(size):
    """The same with zlib's header; its checksum is wrong, which is known at its end only."""
    return b"\x78\x01" + deflated(size) + bytes(4)


@cache
def packed_zeros(how):
    """A GiB of zeros by bz2, one stream after the other, or lz4."""
    if how == "bz2":
        return bz2.compress(ZEROS) * (GIB // len(ZEROS))
    packer = lz4.frame.LZ4FrameCompressor()
    return packer.begin() + b"".join(packer.compress(ZEROS) for _ in range(GIB // len(ZEROS))) + packer.flush()


def resealed(body):
    return body + hashlib.sha256(body).hexdigest().encode()


def with_entry(sealed, name, size, packed, declared=None):
    """A sealed archive with one more entry of zeros, ready packed, that declares any size."""
    source = zipfile.ZipFile(io.BytesIO(sealed))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for info in source.infolist():
            archive.writestr(info, source.read(info))
        info = zipfile.ZipInfo(name)
        archive.writestr(info, packed)
        info.compress_type, info.file_size, info.CRC = zipfile.ZIP_DEFLATED, declared or size, 0
        archive.comment = b"0" * 64
    return resealed(buffer.getvalue()[:-64])


def all_packed(entries):
    """An archive without its seal, of which every entry is packed, however small it becomes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
        archive.comment = b"0" * 64
    return buffer.getvalue()[:-64]


def damaged_deflate(sealed):
    """A packed entry whose stream makes no sense."""
    body = bytearray(all_packed(unseal(sealed)))
    body[100:140] = b"\xff" * 40
    return resealed(bytes(body))


def zero_arrays(count):
    """Arrays of a map of so many keyframes, all zero but what is checked first."""
    sizes = {"K": count, "O": 0, "S": 0, "C": 0, "P": 0, "T": 0}
    arrays = {n: np.zeros([sizes.get(s, s) for s in shape], kind) for n, (kind, shape, _) in LAYOUT.items()}
    for name in ("rotation", "anchor_rotation"):
        arrays[name][:] = np.eye(3)
    arrays["anchor"][:], arrays["scale"][:] = -1, 1.0
    return arrays


def map_of(sealed, arrays, picture=None, width=160, height=120):
    """The map with other arrays, and the same picture for each living keyframe."""
    entries = {"manifest.json": unseal(sealed)["manifest.json"]}
    manifest = json.loads(entries["manifest.json"])
    manifest["camera"] |= {"width": width, "height": height}
    entries["manifest.json"] = json.dumps(manifest).encode()
    entries |= {f"arrays/{name}.npy": array_bytes(array) for name, array in arrays.items()}
    living = range(len(arrays["anchor"])) if picture else ()
    entries |= {f"keyframes/{k:06d}.png": picture for k in living if arrays["anchor"][k] < 0}
    return resealed(all_packed(entries))


def png(width, height, depth=8, colour=0):
    """A black picture."""
    channels = {0: 1, 2: 3, 6: 4}[colour]
    size = height * (1 + width * channels * depth // 8)
    rows = zlib.compress(bytes(size)) if size < 2**23 else zlib_zeros(-(-size // len(ZEROS)) * len(ZEROS))
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)),
        (b"IDAT", rows),
        (b"IEND", b""),
    ]
    body = b"".join(struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks)
    return b"\x89PNG\r\n\x1a\n" + body


def tiff(width, height, *tags):
    """One strip of zeros, by deflate. tags: (tag, type, count, value), after those that tell the size. The eight bytes
    at PLACE hold the height, too."""
    packed = zlib_zeros(-(-width * height // len(ZEROS)) * len(ZEROS))
    size = [(256, 4, 1, width), (257, 4, 1, height)]
    rest = {258: 8, 259: 8, 262: 1, 273: PLACE + 8, 277: 1, 278: height, 279: len(packed)}
    told = sorted([*size, *tags, *((tag, 4, 1, value) for tag, value in rest.items())], key=lambda entry: entry[0])
    if any(entry[:2] == (257, 16) for entry in tags):
        told.remove(size[1])
    entries = b"".join(struct.pack("<HHII", *entry) for entry in told)
    body = struct.pack("<Q", height) + packed
    return b"II*\0" + struct.pack("<I", 8 + len(body)) + body + struct.pack("<H", len(told)) + entries + bytes(4)


def big_tiff(width, height):
    """The header of a TIFF with places of 64 bits."""
    entries = b"".join(struct.pack("<HHQQ", tag, 4, 1, value) for tag, value in {256: width, 257: height}.items())
    return b"II+\0" + struct.pack("<HHQQ", 8, 0, 16, 2) + entries + bytes(8)


def bmp(width, height):
    return b"BM" + struct.pack("<IIIIiiHHIIiiII", 54, 0, 54, 40, width, height, 1, 24, 0, 0, 1, 1, 0, 0)


def jpeg(width, height):
    frame = struct.pack(">BHHBBBB", 8, height, width, 1, 1, 0x11, 0)
    return b"\xff\xd8\xff\xc2" + struct.pack(">H", len(frame) + 2) + frame + b"\xff\xd9"


def ros1_record(data, **fields):
    pairs = {"op" if n == "op" else n: v for n, v in fields.items()}
    header = b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in pairs.items())
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def ros1_bag(how, declared=None, index=True):
    """One image topic, in one chunk of zeros after its connection."""
    definition = ros1_record(b"", **{"message_definition": b"", "md5sum": b"0", "type": b"sensor_msgs/Image"})[4:-4]
    connection = ros1_record(definition, op=b"\x07", conn=bytes(4), topic=b"/i")
    length = struct.pack("<I", GIB if declared is None else declared)
    chunk = ros1_record(packed_zeros(how), op=b"\x05", compression=how.encode(), size=length)
    times = ros1_record(struct.pack("<III", 1, 0, 0), op=b"\x04", ver=b"\1\0\0\0", conn=bytes(4), count=b"\1\0\0\0")
    start = 13 + 4096
    head = {"op": b"\x03", "conn_count": b"\1\0\0\0", "chunk_count": b"\1\0\0\0"}
    head["index_pos"] = struct.pack("<Q", start + len(chunk) + len(times) if index else 0)
    used = len(ros1_record(b"", **head))
    info = ros1_record(
        bytes(4) + b"\1\0\0\0", op=b"\x06", ver=b"\1\0\0\0", chunk_pos=struct.pack("<Q", start),
        start_time=bytes(8), end_time=b"\xff" * 4 + bytes(4), count=b"\1\0\0\0",
    )  # fmt: skip
    begin = b"#ROSBAG V2.0\n" + ros1_record(b" " * (4096 - used), **head)
    return begin + (b"" if index else connection) + chunk + times + connection + info


def ros2_bag(path, plugin, mode=CompressionMode.NONE, size=GIB // 4):
    """A folder with one enormous black image, small where its storage is packed."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    stamp = types.types["builtin_interfaces/msg/Time"](1, 0)
    header = types.types["std_msgs/msg/Header"](stamp, "c")
    side = int(size**0.5)
    message = types.types["sensor_msgs/msg/Image"](
        header, side, side, "mono8", 0, side, np.zeros(side * side, np.uint8)
    )
    writer = Ros2Writer(path, version=8, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/i", message.__msgtype__, typestore=types)
        writer.write(connection, 1, types.serialize_cdr(message, message.__msgtype__))


def computed_table(path, sql):
    """A ROS 2 bag with a table that is computed when it is read."""
    ros2_bag(path, StoragePlugin.SQLITE3, size=32 * 32)
    with closing(sqlite3.connect(path / f"{path.name}.db3")) as base:
        base.executescript(sql)


def _noted(sealed, change):
    entries = unseal(sealed)
    notes = json.loads(entries["checkpoint.json"])
    change(notes)
    return seal({**entries, "checkpoint.json": json.dumps(notes).encode()}, quick=True)


def same_picture(sealed):
    def change(notes):
        notes["files"] = dict.fromkeys(notes["files"], next(iter(notes["files"].values())))

    return _noted(sealed, change)


def same_piece(sealed):
    def change(notes):
        notes["pieces"]["template_patch"] *= 20_000

    return _noted(sealed, change)


LAUGHS = "".join(
    f"{name}: &{name} [{', '.join(['*' + before] * 10 if before else ['x'] * 10)}]\n"
    for before, name in zip(["", *"abcdefgh"], "abcdefghi")
)
YAML_BOMBS = {
    "deep": "[" * DEEP,
    "laughs": LAUGHS,
    "wide": "a: [" + "0," * 4_000_000 + "]",
    "itself": "a: &a [*a]",
    "sixties": "a: 1" + ":1" * 400_000,
    "no integer": "a: !!int ''",
    "no time": "a: !!timestamp x",
    "deep flow in block": "".join(" " * k + "a:\n" for k in range(2000)),
}
JSON_BOMBS = {"deep": "[" * DEEP, "deep object": '{"a":' * DEEP, "digits": "9" * 10_000, "huge": '{"stamp_ns": 1e999}'}
