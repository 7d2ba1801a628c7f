"""Fingerprints on the emulated lens: where they are, the image is blurred and hazy."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array

_PRINT_PX = 40.0, 110.0  # half axes of a print, far out of focus
_SOFT_PX = 15.0  # of its border
_BLUR_PX = 5.0
_CLEAR, _HAZE = 0.15, 0.15  # shares of light that goes straight through, and that is spread over the whole image


class Smear:
    """share: of the image that is smeared, 0 to 0.9; the prints lie by rng."""

    def __init__(self, height: int, width: int, share: float, rng: np.random.Generator) -> None:
        mask = np.zeros((height, width), np.float32)
        while float(mask.mean()) < share:
            centre = int(rng.integers(width)), int(rng.integers(height))
            axes = tuple(int(length) for length in rng.uniform(*_PRINT_PX, 2))
            cv2.ellipse(mask, centre, axes, math.degrees(rng.uniform(0.0, math.pi)), 0.0, 360.0, 1.0, -1)
        self._weight: Float32Array = np.asarray((1.0 - _CLEAR) * cv2.GaussianBlur(mask, (0, 0), _SOFT_PX), np.float32)

    def through(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """The picture (H, W) as it comes through the lens."""
        spread = (1.0 - _HAZE) * cv2.GaussianBlur(radiance, (0, 0), _BLUR_PX) + _HAZE * radiance.mean()
        return np.asarray(radiance + self._weight * (spread - radiance), np.float32)
