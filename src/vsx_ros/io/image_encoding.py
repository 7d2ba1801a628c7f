"""Converts a sensor_msgs/Image or an image file to grey, without cv_bridge (which pip's numpy breaks).

The size of an image file is read from its header, so that too large ones are refused before they are decoded.
Sources: PNG (W3C), section 11.2.2; JPEG (ITU-T T.81), annex B; Netpbm's ppm(5); BMP (BITMAPINFOHEADER); TIFF 6.0,
section 2."""

import re
import struct
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.camera import MAX_PIXELS

# OpenCV's aliases that name the first rows of the mosaic, as ROS does
_TO_GRAY = {
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8UC3": (3, cv2.COLOR_BGR2GRAY),
    "8UC4": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2GRAY),
}
_SMALLEST_MOSAIC = 3
_GRAY_8 = ("mono8", "8UC1")
_GRAY_16 = ("mono16", "16UC1")
_BAYER_16 = tuple(name.replace("8", "16") for name in _TO_GRAY if name.startswith("bayer"))
# which of a pixel's two bytes is its luminance; ROS 1 uses the first two names, ROS 2 the others
_LUMINANCE = {"yuv422": 1, "yuv422_yuy2": 0, "uyvy": 1, "yuyv": 0}
SUPPORTED = (*_GRAY_8, *_GRAY_16, *_TO_GRAY, *_BAYER_16, *_LUMINANCE)
_Bytes: TypeAlias = bytes | NDArray[np.uint8]


def gray_image(
    encoding: str, height: int, width: int, step: int, data: _Bytes, *, big_endian: bool = False, shift_bits: int = 8
) -> GrayImage:
    """(height, width) uint8 from the fields of a sensor_msgs/Image; ``step`` is bytes per row. shift_bits: for 16-bit
    images, how many low bits to drop; values above the top saturate. Raises InputError for an unknown encoding or too
    few bytes."""
    rows = _rows(encoding, height, width, step, data)
    if encoding in _LUMINANCE:
        return np.ascontiguousarray(rows[:, _LUMINANCE[encoding] :: 2])
    if encoding in _GRAY_16 or encoding in _BAYER_16:
        values = rows.view(">u2" if big_endian else "<u2").astype(np.uint32) >> shift_bits
        rows, encoding = np.asarray(np.minimum(values, 255), np.uint8), encoding.replace("16", "8")
    if encoding in _TO_GRAY:
        channels, conversion = _TO_GRAY[encoding]
        pixels = rows if channels == 1 else rows.reshape(height, width, channels)
        if channels == 1 and min(pixels.shape) < _SMALLEST_MOSAIC:
            raise InputError(f"image {width}x{height} {encoding} is too small for a mosaic; record it again")
        return np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
    return rows


def _rows(encoding: str, height: int, width: int, step: int, data: _Bytes) -> GrayImage:
    """(height, bytes) of the pixels, without the rows' padding; raises as ``gray_image`` does."""
    if encoding not in SUPPORTED:
        raise InputError(f"image encoding {encoding!r} is not supported; use one of {', '.join(SUPPORTED)}")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"image says {width}x{height} pixels, of which at most {MAX_PIXELS} can be used; record it again"
        )
    two_bytes = encoding in _GRAY_16 or encoding in _BAYER_16 or encoding in _LUMINANCE
    row_bytes = width * (2 if two_bytes else _TO_GRAY[encoding][0] if encoding in _TO_GRAY else 1)
    flat = np.frombuffer(data, np.uint8)
    if width < 1 or height < 1 or step < row_bytes or flat.size < step * height:
        raise InputError(
            f"image {width}x{height} {encoding} with {step} bytes a row needs at least {row_bytes} bytes a row and "
            f"{max(step, row_bytes) * height} in all, got {flat.size}; the message is damaged, record it again"
        )
    return np.ascontiguousarray(flat[: step * height].reshape(height, step)[:, :row_bytes])


def shift_for(data: _Bytes, *, big_endian: bool = False) -> int:
    """Low bits to drop so that the brightest 16-bit value of an image fits 8 bits (sensors give 8 to 16)."""
    brightest = int(np.frombuffer(data[: len(data) // 2 * 2], ">u2" if big_endian else "<u2").max(initial=0))
    return max(0, brightest.bit_length() - 8)


class GrayImages:
    """Turns the images of one camera grey, in order. Of 16-bit ones it drops the low bits by which the brightest value
    so far exceeds 8 bits."""

    def __init__(self) -> None:
        self._shift_bits = 0

    def of(
        self, encoding: str, height: int, width: int, step: int, data: _Bytes, *, big_endian: bool = False
    ) -> GrayImage:
        """As ``gray_image``."""
        if encoding in _GRAY_16 or encoding in _BAYER_16:
            rows = _rows(encoding, height, width, step, data)
            self._shift_bits = max(self._shift_bits, shift_for(rows.ravel(), big_endian=big_endian))
        return gray_image(encoding, height, width, step, data, big_endian=big_endian, shift_bits=self._shift_bits)


def decoded(compressed: bytes, name: str, said: str = "") -> GrayImage:
    """(H, W) uint8 of a JPEG, PNG, PGM, PPM, BMP or TIFF. said: the format of a sensor_msgs/CompressedImage; if it
    begins with a Bayer encoding, an image of one channel is a mosaic. Raises InputError with the image's name when its
    bytes are not an image."""
    mosaic = said.partition(";")[0].strip()
    how = cv2.IMREAD_UNCHANGED if mosaic.startswith("bayer") else cv2.IMREAD_GRAYSCALE
    with explained(InputError, f"{name} ({len(compressed)} bytes) cannot be used", "give a whole JPEG or PNG"):
        image = picture(compressed, how)
    if image is None:
        raise InputError(f"{name} ({len(compressed)} bytes) cannot be decoded; it must be a whole JPEG or PNG")
    if mosaic.startswith("bayer"):
        if image.dtype != np.uint8 or image.ndim == 3 and image.shape[2] != 3:
            raise InputError(f"{name} is {mosaic} of {image.dtype} and shape {image.shape}; publish it with 8 bits")
        height, width = image.shape[:2]
        return gray_image(mosaic if image.ndim == 2 else "bgr8", height, width, image.strides[0], image.tobytes())
    return np.asarray(image, np.uint8)


FORMATS = "JPEG, PNG, PGM, PPM, BMP or TIFF"
MAX_JPEG_SCANS = 200  # progressive files have ten; each scan goes over all pixels

# As OpenCV reads them: one character ends a number.
_PNM_NUMBER = rb"(?:\s|#[^\r\n]*[\r\n])*(\d{1,9})[^\d]"
_PNM = re.compile(rb"P[1-6]" + 2 * _PNM_NUMBER)
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # JPEG's SOF0 to SOF15 without three other markers
_ALONE = frozenset(range(0xD0, 0xD9)) | {0x01}  # JPEG's markers without a length: RST0 to RST7, SOI; TEM
_IMAGE_TAGS, _TILE_TAGS = (256, 257), (322, 323)  # TIFF: width and length, of the image and of its tiles


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
    """The result of ``cv2.imdecode``, None if damaged. Raises ValueError as ``check_image_size`` does."""
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


def _tiff_size(content: bytes) -> tuple[int, int]:
    """Width and height of the first image, or of its tiles if they are larger."""
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
