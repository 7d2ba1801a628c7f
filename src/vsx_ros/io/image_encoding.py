"""Converts a sensor_msgs/Image or an image file to grey, without cv_bridge (which pip's numpy breaks)."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.camera import MAX_PIXELS
from vsx_ros.io.image_file import camera_picture

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
# ROS names images of 16 bits as those of 8
_OF_8 = {name.replace("8", "16"): name for name in (*_GRAY_8, *_TO_GRAY)}
# which of a pixel's two bytes is its luminance; ROS 1 uses the first two names, ROS 2 the others
_LUMINANCE = {"yuv422": 1, "yuv422_yuy2": 0, "uyvy": 1, "yuyv": 0}
SUPPORTED = (*_GRAY_8, *_TO_GRAY, *_OF_8, *_LUMINANCE)
_SHOWN = 0.99  # of the pixels of a first image: brighter ones are lamps, reflections and faults of the sensor
_FIRST_IMAGES = 30  # of a camera that adapts to the light
_CONTRAST = 32  # between dark and bright pixels: with less, a 16-bit image shows noise
_SAMPLES = 20_000  # pixels of an image that are looked at
_COLOURS = 3  # channels before alpha
_Bytes: TypeAlias = bytes | NDArray[np.uint8]


def gray_image(
    encoding: str, height: int, width: int, step: int, data: _Bytes, *, big_endian: bool = False, shift_bits: int = 8,
    name: str = "image",
) -> GrayImage:  # fmt: skip
    """(height, width) uint8 from the fields of a sensor_msgs/Image; ``step`` is bytes per row. shift_bits: for 16-bit
    images, how many low bits to drop; values above the top saturate. name: for messages. Raises InputError for an
    unknown encoding or too few bytes."""
    rows = _rows(encoding, height, width, step, data, name)
    if encoding in _LUMINANCE:
        return np.ascontiguousarray(rows[:, _LUMINANCE[encoding] :: 2])
    if encoding in _OF_8:
        values = _values(rows, big_endian=big_endian) >> shift_bits
        rows, encoding = np.asarray(np.minimum(values, 255), np.uint8), _OF_8[encoding]
    if encoding in _TO_GRAY:
        channels, conversion = _TO_GRAY[encoding]
        pixels = rows if channels == 1 else rows.reshape(height, width, channels)
        if channels == 1 and min(pixels.shape) < _SMALLEST_MOSAIC:
            raise InputError(f"{name} of {width}x{height} {encoding} is too small for a mosaic; record it again")
        return np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
    return rows


def _values(rows: GrayImage, *, big_endian: bool) -> NDArray[np.uint16]:
    return rows.view(">u2" if big_endian else "<u2")


def _rows(encoding: str, height: int, width: int, step: int, data: _Bytes, name: str) -> GrayImage:
    """(height, bytes) of the pixels, without the rows' padding; raises as ``gray_image`` does."""
    if encoding not in SUPPORTED:
        raise InputError(f"{name} has the encoding {encoding!r}; publish it as one of {', '.join(SUPPORTED)}")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{name} says {width}x{height} pixels, of which at most {MAX_PIXELS} can be used; record it again"
        )
    of_8 = _OF_8.get(encoding, encoding)
    row_bytes = width * (_TO_GRAY[of_8][0] if of_8 in _TO_GRAY else 1)
    row_bytes *= 2 if encoding in _OF_8 or encoding in _LUMINANCE else 1
    flat = np.frombuffer(data, np.uint8)
    if width < 1 or height < 1 or step < row_bytes or flat.size < step * height:
        raise InputError(
            f"{name} of {width}x{height} {encoding} with {step} bytes a row needs at least {row_bytes} bytes a row and "
            f"{max(step, row_bytes) * height} in all, got {flat.size}; the message is damaged, record it again"
        )
    return np.ascontiguousarray(flat[: step * height].reshape(height, step)[:, :row_bytes])


def shift_for(values: NDArray[np.uint16], share: float = _SHOWN) -> int:
    """Low bits to drop so that this share of the 16-bit values, without the brightest, fits 8 bits."""
    return max(0, int(np.quantile(values, share)).bit_length() - 8)


class GrayImages:
    """Turns the images of one camera grey, in order. Of 16-bit ones it drops the low bits by which the first images
    that show something exceed 8 bits (sensors give 8 to 16). Highlights saturate. An image most of which would saturate
    is a first one again."""

    def __init__(self) -> None:
        self._shift_bits, self._firsts = 0, 0

    def of(
        self, encoding: str, height: int, width: int, step: int, data: _Bytes, *, big_endian: bool = False,
        name: str = "image",
    ) -> GrayImage:  # fmt: skip
        """As ``gray_image``."""
        if encoding in _OF_8:
            rows = _rows(encoding, height, width, step, data, name)
            channels, _ = _TO_GRAY.get(_OF_8[encoding], (1, 0))
            pixels = _values(rows, big_endian=big_endian).reshape(-1, channels)[:, :_COLOURS]
            self._follow(pixels[:: len(pixels) // _SAMPLES | 1])  # an odd step meets all colours of a mosaic
        shift_bits = self._shift_bits
        return gray_image(encoding, height, width, step, data, big_endian=big_endian, shift_bits=shift_bits, name=name)

    def _follow(self, values: NDArray[np.uint16]) -> None:
        """Take values of the next 16-bit image."""
        if shift_for(values, 0.5) > self._shift_bits:
            self._firsts = 0
        if self._firsts < _FIRST_IMAGES:
            self._shift_bits = max(self._shift_bits, shift_for(values))
            dark, bright = np.quantile(values, [1.0 - _SHOWN, _SHOWN])
            self._firsts += bool(bright - dark >= _CONTRAST)

    def of_file(self, content: bytes, name: str, said: str = "") -> GrayImage:
        """(H, W) uint8 of a JPEG, PNG, PGM, PPM, BMP or TIFF, with its pixels where the sensor has them, whatever the
        metadata says of rotation. said: the format of a sensor_msgs/CompressedImage; if it begins with a Bayer
        encoding, an image of one channel is a mosaic. Raises InputError with the image's name when it cannot be
        used."""
        mosaic = said.partition(";")[0].strip()
        mosaic = mosaic.rstrip("0123456789") if mosaic.startswith("bayer") else ""
        with explained(InputError, f"{name} ({len(content)} bytes) cannot be used", "give a whole JPEG or PNG"):
            if "compressedDepth" in said:
                raise ValueError("it is a depth image; choose the camera's topic")
            image = camera_picture(content, colour=bool(mosaic))
        if image.ndim == 2 and image.dtype == np.uint8 and not mosaic:
            return np.asarray(image, np.uint8)
        channels = {1: mosaic or "mono", 3: "bgr", 4: "bgra"}[image[0, 0].size]
        pixels = np.ascontiguousarray(image).view(np.uint8).reshape(len(image), -1)
        encoding, (height, width) = f"{channels}{image.dtype.itemsize * 8}", image.shape[:2]
        return self.of(encoding, height, width, pixels.shape[1], pixels.ravel(), name=name)
