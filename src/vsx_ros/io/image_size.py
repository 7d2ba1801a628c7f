"""How large an image file says it is, read from its first bytes: what is too large is refused before it is decoded.

Sources: PNG (W3C), section 11.2.2; JPEG (ITU-T T.81), annex B; Netpbm's ppm(5); BMP (BITMAPINFOHEADER); TIFF 6.0,
section 2.
"""

import re
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.geometry.camera import MAX_PIXELS

FORMATS = "JPEG, PNG, PGM, PPM, BMP or TIFF"
MAX_JPEG_SCANS = 200
"""Progressive files have ten; each is a walk over all pixels."""

# As OpenCV reads them: one character ends a number.
_PNM_NUMBER = rb"(?:\s|#[^\r\n]*[\r\n])*(\d{1,9})[^\d]"
_PNM = re.compile(rb"P[1-6]" + 2 * _PNM_NUMBER)
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_ALONE = frozenset(range(0xD0, 0xD9)) | {0x01}
_IMAGE_TAGS, _TILE_TAGS = (256, 257), (322, 323)


def check_image_size(content: bytes, most_pixels: int = MAX_PIXELS) -> tuple[int, int]:
    """Width and height [px]. Raises ValueError for another format, and for an image of more pixels."""
    try:
        width, height = _size(content)
    except (struct.error, IndexError) as error:
        raise ValueError("its header is cut short") from error
    if width < 1 or height < 1 or width * height > most_pixels:
        raise ValueError(f"it says it has {width}x{height} pixels, of which 1 to {most_pixels} can be used")
    if content.startswith(b"\xff\xd8") and content.count(b"\xff\xda") > MAX_JPEG_SCANS:
        raise ValueError(f"it has more than {MAX_JPEG_SCANS} scans")
    return width, height


def picture(content: bytes, how: int, most_pixels: int = MAX_PIXELS) -> NDArray[Any] | None:
    """What ``cv2.imdecode`` makes of it, None where it is damaged. Raises ValueError as ``check_image_size`` does."""
    check_image_size(content, most_pixels)
    try:
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), how)
    except cv2.error:
        return None
    return image


def _size(content: bytes) -> tuple[int, int]:
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        return struct.unpack_from(">II", content, 16)
    if content.startswith(b"\xff\xd8"):
        return _jpeg_size(content)
    if content.startswith(b"BM"):
        small = struct.unpack_from("<I", content, 14)[0] == 12
        width, height = struct.unpack_from("<HH" if small else "<ii", content, 18)
        return width, abs(height)
    if content.startswith((b"II*\x00", b"MM\x00*")):
        return _tiff_size(content)
    netpbm = _PNM.match(content)
    if netpbm:
        return int(netpbm[1]), int(netpbm[2])
    raise ValueError(f"it is no {FORMATS}")


def _jpeg_size(content: bytes) -> tuple[int, int]:
    """Of the first frame header; as libjpeg does, whatever stands between two segments is passed over."""
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


def _tiff_size(content: bytes) -> tuple[int, int]:
    """Of the first image, or of a tile that is larger."""
    order = "<" if content.startswith(b"II") else ">"
    (directory,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, directory)
    found: dict[int, int] = {}
    for k in range(count):
        at = directory + 2 + 12 * k
        tag, kind = struct.unpack_from(f"{order}HH", content, at)
        if tag in (*_IMAGE_TAGS, *_TILE_TAGS):
            found[tag] = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", content, at + 8)[0]
    sizes = [(found.get(wide, 0), found.get(high, 0)) for wide, high in (_IMAGE_TAGS, _TILE_TAGS)]
    return max(sizes, key=lambda size: size[0] * size[1])
