"""An image pyramid in one flat buffer, so that one kernel call can work on all levels; blur detection; and a small
blurred image for the rotation between frames and the similarity of places (PTAM's SmallBlurryImage)."""

from __future__ import annotations

import statistics
from collections import deque
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, GrayImage, IntArray, Pixels
from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import so3_exp
from vsx_ros.kernels.vision.alignment import align_small

LEVELS = 4  # each half as large as the one before: VGA down to 80 x 60
SHRINK = 16  # factor of the small image: 40 x 30 for VGA
FINE, COARSE = 0, 3  # levels compared: the first and the last
JPEG = b"\xff\xd8"  # how such a file begins
_QUALITY = 90  # of 100: 53 kB for VGA and 1.9 grey levels off, where a lossless .png takes 150 kB
NEIGHBOURS, LEAST = 9, 3  # most and least number of earlier frames to compare with (half a second)
# A fifth of the rows is as good as all of them.
ROW_STEP = 5
# A blur of 9 px leaves less than this share of the gradient energy along it; a steady camera keeps more than 0.8.
# Hand-held frames lie between (down to 0.28 and 0.48 of their neighbours in two recordings): a little blurred, or with
# less texture in view. Some of them count as blurred too, which costs a keyframe, not the pose.
BLURRED_SHARE = 0.45

SmallImage: TypeAlias = NDArray[np.float32]  # (H / 16, W / 16) float32 grey values minus their mean, blurred


class Pyramid(NamedTuple):
    """pixels (B,) uint8: all levels, row-major; table (4, 4) int64: (offset, height, width, first row) per level."""

    pixels: NDArray[np.uint8]
    table: NDArray[np.int64]

    def level(self, index: int) -> GrayImage:
        """(H >> index, W >> index) view of one level."""
        offset, height, width, _ = self.table[index].tolist()
        return self.pixels[offset : offset + height * width].reshape(height, width)


class CompressedPyramid(NamedTuple):
    """A pyramid in an eighth of the memory: its finest level, as the content of a picture file."""

    content: bytes

    @staticmethod
    def of(image: Pyramid) -> CompressedPyramid:
        """As a .jpg, which is off by less than a camera's noise."""
        return CompressedPyramid(bytes(cv2.imencode(".jpg", image.level(0), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]))

    @property
    def is_small(self) -> bool:
        """Whether it was made by ``of``: files also hold larger pictures."""
        return self.content.startswith(JPEG)

    @property
    def pyramid(self) -> Pyramid:
        """All levels. Those used last are remembered."""
        return _pyramid_of(self.content)


@lru_cache(maxsize=32)  # of VGA, 13 MB; a place that is seen again needs about ten
def _pyramid_of(content: bytes) -> Pyramid:
    return build_pyramid(np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE), np.uint8))


def remembered_bytes(height: int, width: int) -> int:
    """Size of the pictures, all of one size, that ``CompressedPyramid.pyramid`` remembers."""
    return _pyramid_of.cache_info().currsize * layout(height, width)[1]


def picture_file(image: Pyramid | CompressedPyramid) -> bytes:
    """What a file keeps of a pyramid: what is compressed as it is, else a .png without loss. A camera's noise repeats
    nothing, so no repetition is looked for."""
    if isinstance(image, CompressedPyramid):
        return image.content
    how = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    return bytes(cv2.imencode(".png", image.level(0), how)[1])


def to_level(uv: Pixels, level: int | IntArray) -> Pixels:
    """Convert level-0 pixels to pixels of a pyramid level."""
    scale = np.asarray(2.0 ** np.asarray(level, float)).reshape(-1, 1)
    return (uv + 0.5) / scale - 0.5


def from_level(uv: Pixels, level: int | IntArray) -> Pixels:
    """Convert pixels of a pyramid level to level-0 pixels."""
    scale = np.asarray(2.0 ** np.asarray(level, float)).reshape(-1, 1)
    return (uv + 0.5) * scale - 0.5


def build_pyramid(image: GrayImage) -> Pyramid:
    """Halve thrice by 2x2 means (PTAM). Raises InputError for anything but an (H, W) uint8 image of 128x96 or more."""
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != np.uint8:
        kind = f"{getattr(image, 'dtype', type(image).__name__)} of shape {getattr(image, 'shape', '?')}"
        raise InputError(f"image: expected (H, W) uint8 grey values, got {kind}; convert it to mono8")
    height, width = image.shape
    if height < 96 or width < 128:
        raise InputError(f"image: {width}x{height} is too small for a four-level pyramid; use at least 128x96")
    table, size = layout(height, width)
    pyramid = Pyramid(np.empty(size, np.uint8), table)
    finer = pyramid.level(0)
    finer[:] = image
    for index in range(1, LEVELS):
        finer = shrunk(finer, 2, pyramid.level(index))
    return pyramid


def shrunk(image: GrayImage, times: int, into: GrayImage | None = None) -> GrayImage:
    """Means of squares of ``times`` px. A part of a square, at the right or at the bottom, is left out: the scale is
    exact. into: where the result belongs."""
    height, width = image.shape[0] // times, image.shape[1] // times
    whole = image[: times * height, : times * width]
    return np.asarray(cv2.resize(whole, (width, height), dst=into, interpolation=cv2.INTER_AREA))


@lru_cache(maxsize=4)
def layout(height: int, width: int) -> tuple[NDArray[np.int64], int]:
    """(table, size of the buffer), the same for all images of a size."""
    table = np.zeros((LEVELS, 4), np.int64)
    offset, row = 0, 0
    for index in range(LEVELS):
        h, w = height >> index, width >> index
        table[index] = offset, h, w, row
        offset += h * w
        row += h + 1
    return table, offset


def small_image(pyramid: Pyramid) -> SmallImage:
    """Level 3 halved once more (40x30 for VGA), blurred by 0.75 px, zero mean."""
    small = shrunk(pyramid.level(3), 2).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), 0.75)
    return np.asarray(small - np.float32(small.mean(dtype=np.float64)))


def rotation_between(
    reference: SmallImage, current: SmallImage, focal_px: tuple[float, float]
) -> tuple[FloatArray, float]:
    """(R_current_reference (3, 3), mean squared difference) explaining the motion by rotation alone.

    focal_px: fx and fy at level 0. The difference is infinite when the alignment leaves the image."""
    tx, ty, roll, score = align_small(reference, current, 8)
    fx, fy = focal_px
    return so3_exp(np.array([-ty * SHRINK / fy, tx * SHRINK / fx, roll])), float(score)


class BlurDetector:
    """Call ``blurred`` for each frame in order. Blur removes gradients on the finest level but not on the coarsest; a
    bare wall removes both. Motion blur acts along one axis. If most earlier frames are blurred, blur is normal."""

    def __init__(self) -> None:
        self._neighbours: deque[tuple[float, float]] = deque(maxlen=NEIGHBOURS)

    def blurred(self, pyramid: Pyramid) -> bool:
        """Whether this frame is much less sharp than the median of those before it."""
        now, before = sharpness(pyramid), self._neighbours
        blurred = len(before) >= LEAST and any(
            value < BLURRED_SHARE * statistics.median(usual) for value, usual in zip(now, zip(*before))
        )
        before.append(now)
        return blurred


def sharpness(pyramid: Pyramid) -> tuple[float, float]:
    """Mean squared difference of neighbouring pixels on the finest level (every fifth row) over that on the coarsest,
    along the rows and along the columns."""
    fine, coarse = _energy(pyramid.level(FINE), ROW_STEP), _energy(pyramid.level(COARSE), 1)
    # One squared grey level: sensor noise on the coarsest level.
    return fine[0] / (coarse[0] + 1.0), fine[1] / (coarse[1] + 1.0)


def _energy(image: GrayImage, step: int) -> tuple[float, float]:
    above, below = image[:-1:step], image[1::step]
    along_row = cv2.norm(above[:, 1:], above[:, :-1], cv2.NORM_L2SQR)
    return along_row / above[:, 1:].size, cv2.norm(below, above, cv2.NORM_L2SQR) / above.size
