"""Four-level image pyramid in one flat buffer, so that one kernel call can work on all levels."""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.errors import InputError

LEVELS = 4


class Pyramid(NamedTuple):
    """pixels (B,) uint8: all levels, row-major; table (4, 4) int64: (offset, height, width, first row) per level."""

    pixels: NDArray[np.uint8]
    table: NDArray[np.int64]

    def level(self, index: int) -> GrayImage:
        """(H >> index, W >> index) view of one level."""
        offset, height, width, _ = self.table[index].tolist()
        return self.pixels[offset : offset + height * width].reshape(height, width)


def build_pyramid(image: GrayImage) -> Pyramid:
    """Halve by 2x2 means, three times (PTAM). Raises InputError for anything but an (H, W) uint8 image of at least
    128x96."""
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != np.uint8:
        kind = f"{getattr(image, 'dtype', type(image).__name__)} of shape {getattr(image, 'shape', '?')}"
        raise InputError(f"image: expected (H, W) uint8 grey values, got {kind}; convert it to mono8")
    height, width = image.shape
    if height < 96 or width < 128:
        raise InputError(f"image: {width}x{height} is too small for a four-level pyramid; use at least 128x96")
    table, size = _layout(height, width)
    pyramid = Pyramid(np.empty(size, np.uint8), table)
    finer = pyramid.level(0)
    finer[:] = image
    for index in range(1, LEVELS):
        h, w = height >> index, width >> index
        level = pyramid.level(index)
        cv2.resize(finer[: 2 * h, : 2 * w], (w, h), dst=level, interpolation=cv2.INTER_AREA)
        finer = level
    return pyramid


@lru_cache(maxsize=4)
def _layout(height: int, width: int) -> tuple[NDArray[np.int64], int]:
    """(table, size of the buffer), the same for all images of a size."""
    table = np.zeros((LEVELS, 4), np.int64)
    offset, row = 0, 0
    for index in range(LEVELS):
        h, w = height >> index, width >> index
        table[index] = offset, h, w, row
        offset += h * w
        row += h + 1
    return table, offset
