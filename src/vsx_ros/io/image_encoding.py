"""Pixels of a sensor_msgs/Image to grey, without cv_bridge (which pip's numpy breaks)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.camera import MAX_PIXELS
from vsx_ros.io.image_size import picture

# OpenCV's aliases that spell the mosaic's own first rows, as ROS does
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
# of each pixel's two bytes, which one is its luminance; ROS 1 has the first two names, ROS 2 the others
_LUMINANCE = {"yuv422": 1, "yuv422_yuy2": 0, "uyvy": 1, "yuyv": 0}
SUPPORTED = (*_GRAY_8, *_GRAY_16, *_TO_GRAY, *_BAYER_16, *_LUMINANCE)


def gray_image(
    encoding: str,
    height: int,
    width: int,
    step: int,
    data: bytes | NDArray[np.uint8],
    *,
    big_endian: bool = False,
    shift_bits: int = 8,
) -> GrayImage:
    """(height, width) uint8 from the fields of a sensor_msgs/Image; ``step`` is bytes per row.

    shift_bits: for 16-bit images, how many low bits to drop; values above the top saturate.
    Raises InputError for an unknown encoding or too few bytes.
    """
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


def _rows(encoding: str, height: int, width: int, step: int, data: bytes | NDArray[np.uint8]) -> GrayImage:
    """(height, bytes) of the pixels, without what pads the rows; raises as ``gray_image`` does."""
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


def shift_for(data: bytes | NDArray[np.uint8], *, big_endian: bool = False) -> int:
    """Low bits to drop so that the brightest 16-bit value of a first image fits 8 bits (sensors give 8 to 16)."""
    brightest = int(np.frombuffer(data[: len(data) // 2 * 2], ">u2" if big_endian else "<u2").max(initial=0))
    return max(0, brightest.bit_length() - 8)


def decoded(compressed: bytes, name: str, said: str = "") -> GrayImage:
    """(H, W) uint8 of a JPEG, PNG, PGM, PPM, BMP or TIFF.

    said: the format of a sensor_msgs/CompressedImage; where it begins with a Bayer encoding, an image of one channel
    is a mosaic. Raises InputError with the name of the image when its bytes are not an image.
    """
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
