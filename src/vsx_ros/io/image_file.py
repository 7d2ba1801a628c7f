"""The pixels of an image file. Its size is read from its header, so that too large ones are refused before they are
decoded.

Sources: PNG (W3C), section 11.2.2; JPEG (ITU-T T.81), annex B; Netpbm's ppm(5); BMP (BITMAPINFOHEADER); TIFF 6.0,
sections 2 and 8, and page 31 (ExtraSamples)."""

import re
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.geometry.camera import MAX_PIXELS

FORMATS = "JPEG, PNG, PGM, PPM, BMP or TIFF"
MAX_JPEG_SCANS = 200  # progressive files have ten; each scan goes over all pixels

# As OpenCV reads them: one character ends a number.
_PNM_NUMBER = rb"(?:\s|#[^\r\n]*[\r\n])*(\d{1,9})[^\d]"
_PNM = re.compile(rb"P[1-6]" + 2 * _PNM_NUMBER)
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # JPEG's SOF0 to SOF15 without three other markers
_ALONE = frozenset(range(0xD0, 0xD9)) | {0x01}  # JPEG's markers without a length: RST0 to RST7, SOI; TEM
_JPEG = b"\xff\xd8"
_TIFF = (b"II*\x00", b"MM\x00*")
_IMAGE_TAGS, _TILE_TAGS = (256, 257), (322, 323)  # TIFF: width and length, of the image and of its tiles
_BITS, _ORIENTATION, _EXTRA_SAMPLES = 258, 274, 338  # TIFF's tags
_SIZE_TAGS = {*_IMAGE_TAGS, *_TILE_TAGS}
_TAGS = _SIZE_TAGS | {_BITS, _ORIENTATION, _EXTRA_SAMPLES}
_SIZE_KINDS = 3, 4  # TIFF: SHORT and LONG, the types that section 8 gives to sizes
_KINDS = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i", 16: "Q", 17: "q"}  # TIFF's integers; two are libtiff's own
_TOO_MANY_BITS, _UPRIGHT, _ALPHA = (32, 64), 1, (1, 2)  # their values


def check_image_size(content: bytes, most_pixels: int = MAX_PIXELS) -> tuple[int, int]:
    """Width and height [px]. Raises ValueError for another format, and for an image of more pixels."""
    try:
        sizes = _sizes(content)
    except (struct.error, IndexError) as error:
        raise ValueError("its header is cut short") from error
    for width, height in sizes:
        if width < 1 or height < 1 or width * height > most_pixels:
            raise ValueError(f"it says it has {width}x{height} pixels, of which 1 to {most_pixels} can be used")
    if content.startswith(_JPEG) and content.count(b"\xff\xda") > MAX_JPEG_SCANS:
        raise ValueError(f"it has more than {MAX_JPEG_SCANS} scans")
    return sizes[0]


def picture(content: bytes, how: int, most_pixels: int = MAX_PIXELS) -> NDArray[Any] | None:
    """The result of ``cv2.imdecode``, None if damaged. Raises ValueError as ``check_image_size`` does, and for an image
    of another size than it says."""
    size = check_image_size(content, most_pixels)
    try:
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), how)
    except cv2.error:
        return None
    if image is not None and sorted(image.shape[:2]) != sorted(size):  # it may have been turned
        height, width = image.shape[:2]
        raise ValueError(f"it says it has {size[0]}x{size[1]} pixels, and has {width}x{height}")
    return image


def camera_picture(content: bytes, *, colour: bool) -> NDArray[Any]:
    """(H, W), or (H, W, 3 or 4) if colour, of uint8 or uint16, as the sensor saw it: neither turned by its metadata nor
    darkened by its alpha channel. Raises ValueError if that is not possible."""
    check_image_size(content)
    tags = _tiff_tags(content) if content.startswith(_TIFF) else {}  # OpenCV always turns and darkens these
    if tags.get(_ORIENTATION, _UPRIGHT) != _UPRIGHT:
        raise ValueError("its metadata turns it; save it without an orientation")
    if tags.get(_EXTRA_SAMPLES) in _ALPHA:
        raise ValueError("it has an alpha channel; save it without one")
    if tags.get(_BITS) in _TOO_MANY_BITS:
        raise ValueError(f"its pixels have {tags[_BITS]} bits; save it with 8 or 16 bits")
    gray = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = picture(content, cv2.IMREAD_UNCHANGED if colour else gray)
    if image is None:
        raise ValueError("it cannot be decoded")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"its pixels are {image.dtype}; save it with 8 or 16 bits")
    return image


def _sizes(content: bytes) -> list[tuple[int, int]]:
    """Width and height of the image, and of its tiles, if any: each is decoded into memory of its size."""
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        return [struct.unpack_from(">II", content, 16)]
    if content.startswith(_JPEG):
        return [_jpeg_size(content)]
    if content.startswith(b"BM"):
        small = struct.unpack_from("<I", content, 14)[0] == 12
        width, height = struct.unpack_from("<HH" if small else "<ii", content, 18)
        return [(width, abs(height))]
    if content.startswith(_TIFF):
        tags = _tiff_tags(content)
        sizes = [(tags.get(wide, 0), tags.get(high, 0)) for wide, high in (_IMAGE_TAGS, _TILE_TAGS)]
        return sizes if any(sizes[1]) else sizes[:1]
    netpbm = _PNM.match(content)
    if netpbm:
        return [(int(netpbm[1]), int(netpbm[2]))]
    raise ValueError(f"it is no {FORMATS}")


def _jpeg_size(content: bytes) -> tuple[int, int]:
    """Width and height of the first frame header. Like libjpeg, it skips any bytes between two segments."""
    at = 2
    while True:
        at = content.find(b"\xff", at)
        if at < 0:
            raise IndexError
        while content[at] == 0xFF:
            at += 1
        marker, at = content[at], at + 1
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", content, at + 3)
            return width, height
        if marker and marker not in _ALONE:
            at += struct.unpack_from(">H", content, at)[0]


def _tiff_tags(content: bytes) -> dict[int, int]:
    """Those tags of the first image, which OpenCV decodes, that are used here; of several numbers the first. Raises
    ValueError for what decoders may read in another way: a size of another type, or a tag that comes twice."""
    order = "<" if content.startswith(b"II") else ">"
    (directory,) = struct.unpack_from(f"{order}I", content, 4)
    (entries,) = struct.unpack_from(f"{order}H", content, directory)
    found: dict[int, int] = {}
    for k in range(entries):
        at = directory + 2 + 12 * k
        tag, kind, count = struct.unpack_from(f"{order}HHI", content, at)
        if tag not in _TAGS:
            continue
        if tag in _SIZE_TAGS and (kind not in _SIZE_KINDS or count != 1):
            raise ValueError(f"its size (tag {tag}) has type {kind} and count {count}, not type 3 or 4 and count 1")
        if tag in found:
            raise ValueError(f"its tag {tag} comes twice")
        if kind in _KINDS and count > 0:
            fits = count * struct.calcsize(_KINDS[kind]) <= 4  # else the entry holds the place of its numbers
            place = at + 8 if fits else struct.unpack_from(f"{order}I", content, at + 8)[0]
            found[tag] = struct.unpack_from(f"{order}{_KINDS[kind]}", content, place)[0]
    return found
