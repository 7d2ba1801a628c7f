"""Frames that motion or focus has blurred, told by their neighbours."""

import statistics
from collections import deque

import cv2

from vsx_ros.arrays import GrayImage
from vsx_ros.vision.pyramid import Pyramid

FINE, COARSE = 0, 3
NEIGHBOURS, LEAST = 9, 3
# A fifth of the rows tells as much as all of them.
ROW_STEP = 5
# A blur of 9 px leaves less than this of the gradient energy along it, a frame of a steady camera keeps more than 0.8.
# Between them are hand-held frames, blurred a little or turned to what has less texture (down to 0.28 and 0.48 of their
# neighbours in two recordings): some of them are called blurred too, which costs a keyframe, not the pose.
BLURRED_SHARE = 0.45


class BlurDetector:
    """``blurred`` each frame in order. Blur takes gradients from the finest level and leaves the coarsest alone, a bare
    wall takes both; blur by motion takes those along one axis. When most neighbours are blurred, blurred is normal."""

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
    # One squared grey level: what is left of sensor noise on the coarsest level.
    return fine[0] / (coarse[0] + 1.0), fine[1] / (coarse[1] + 1.0)


def _energy(image: GrayImage, step: int) -> tuple[float, float]:
    above, below = image[:-1:step], image[1::step]
    along_row = cv2.norm(above[:, 1:], above[:, :-1], cv2.NORM_L2SQR)
    return along_row / above[:, 1:].size, cv2.norm(below, above, cv2.NORM_L2SQR) / above.size
