"""A fault that any camera may have: it repeats one image for ever."""

import numpy as np
from numpy.typing import NDArray

ROW_STEP = 8  # to save time
REPEATS = 4  # Up to here repetitions may be chance or come from a kernel driver; a Kinect makes them in 0.13 s
FROZEN = "shows the same picture again and again; uncover it, or replug it"


class FrozenImageDetector:
    """Detects a camera that repeats one image: its stream looks healthy, but the robot would drive blind.

    Compares each image with the previous one, every eighth row, bit by bit. Noise makes the images of a working camera
    differ, even in a static scene. A covered lens gives identical black images and counts as frozen. This works at
    standstill too, without odometry."""

    def __init__(self) -> None:
        self._rows: NDArray[np.uint8] = np.empty(0, np.uint8)
        self._repeats = 0

    def is_frozen(self, image: NDArray[np.uint8]) -> bool:
        """Whether this image, (H, W) or (H, W, C), was repeated more than REPEATS times in a row."""
        rows = image[::ROW_STEP]
        if np.array_equal(rows, self._rows):
            self._repeats += 1
        else:
            self._rows, self._repeats = rows.copy(), 0
        return self._repeats > REPEATS
