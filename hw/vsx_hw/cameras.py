"""What any camera may do: show the same picture for ever."""

import numpy as np
from numpy.typing import NDArray

ROW_STEP = 8  # for time
REPEATS = 4  # So many repetitions may be chance or the work of a kernel driver; a Kinect makes them in 0.13 s
FROZEN = "shows the same picture again and again; uncover it, or replug it"


class FrozenImageDetector:
    """Finds a camera whose stream looks healthy while whoever follows it drives blind.

    Compares each picture with the one before, every eighth row bit by bit: noise makes those of a living camera
    differ, even of a scene in which nothing moves. A covered lens is as black in each picture, and frozen as well. This
    is told at standstill, too; what odometry adds (``ros/slam_input.py``) no driver knows."""

    def __init__(self) -> None:
        self._rows: NDArray[np.uint8] = np.empty(0, np.uint8)
        self._repeats = 0

    def is_frozen(self, image: NDArray[np.uint8]) -> bool:
        """Whether this picture, (H, W) or (H, W, C), has come more than REPEATS times in a row after the first."""
        rows = image[::ROW_STEP]
        if np.array_equal(rows, self._rows):
            self._repeats += 1
        else:
            self._rows, self._repeats = rows.copy(), 0
        return self._repeats > REPEATS
