"""Frames that motion or focus has blurred, told by their neighbours."""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, GrayImage
from vsx_ros.vision.pyramid import Pyramid

FINE, COARSE = 0, 3
NEIGHBOURS, LEAST = 9, 3
# A blur of 9 px leaves less than this of the gradient energy along it (measured on four recordings); frames of a steady
# camera keep more than 0.8.
BLURRED_SHARE = 0.45


class BlurDetector:
    """``blurred`` each frame in order. Blur takes gradients from the finest level and leaves the coarsest alone, a bare
    wall takes both; blur by motion takes those along one axis. When most neighbours are blurred, blurred is normal."""

    def __init__(self) -> None:
        self._neighbours: deque[FloatArray] = deque(maxlen=NEIGHBOURS)

    def blurred(self, pyramid: Pyramid) -> bool:
        """Whether this frame is much less sharp than the median of those before it."""
        now = sharpness(pyramid)
        usual = np.median(self._neighbours, axis=0) if len(self._neighbours) >= LEAST else np.zeros(2)
        self._neighbours.append(now)
        return bool((now < BLURRED_SHARE * usual).any())


def sharpness(pyramid: Pyramid) -> FloatArray:
    """(2,) mean squared difference of neighbouring pixels on the finest level over that on the coarsest, along the rows
    and along the columns."""
    fine, coarse = _energy(pyramid.level(FINE)), _energy(pyramid.level(COARSE))
    # One squared grey level: what is left of sensor noise on the coarsest level.
    ratio: FloatArray = fine / (coarse + 1.0)
    return ratio


def _energy(image: GrayImage) -> FloatArray:
    pairs = (image[:, 1:], image[:, :-1]), (image[1:], image[:-1])
    return np.array([cv2.norm(a, b, cv2.NORM_L2SQR) / a.size for a, b in pairs])
