"""Which views of a board are worth keeping, and what is still missing."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.camera import GOOD_VIEWS, BoardView

NOVEL, MAX_VIEWS = 0.2, 40
EDGE, NEAR, FAR, TILT = 0.12, 0.4, 0.35, 0.08


class ViewChooser:
    """Keeps views that differ in place, size or tilt: a hundred alike weigh down the few that tell something."""

    def __init__(self, board: Board, width: int, height: int) -> None:
        self._board, self._size = board, np.array([width, height], float)
        self._features: list[FloatArray] = []
        self.views: list[BoardView] = []

    def offer(self, view: BoardView) -> bool:
        """Keep the view if it is unlike all before. Whether it was kept."""
        feature = self._feature(view)
        alike = any(np.abs(feature - known).sum() < NOVEL for known in self._features)
        if alike or len(self.views) >= MAX_VIEWS:
            return False
        self._features.append(feature)
        self.views.append(view)
        return True

    def missing(self) -> list[str]:
        """Where the board was not shown yet, in words; nothing when the views will do."""
        if not self.views:
            return ["the whole board"]
        pixels = np.concatenate([view.pixels for view in self.views]) / self._size
        _, _, size, across, along = np.array(self._features).T
        wanted = {
            "at the left edge": pixels[:, 0].min() > EDGE,
            "at the right edge": pixels[:, 0].max() < 1.0 - EDGE,
            "at the top": pixels[:, 1].min() > EDGE,
            "at the bottom": pixels[:, 1].max() < 1.0 - EDGE,
            "near, filling nearly half the picture": size.max() < NEAR,
            "farther away": size.min() > FAR,
            "tilted to the left and right": np.ptp(across) < 2.0 * TILT,
            "tilted up and down": np.ptp(along) < 2.0 * TILT,
        }
        more = ["from more sides"] if len(self.views) < GOOD_VIEWS else []
        return [words for words, lacking in wanted.items() if lacking] + more

    def _feature(self, view: BoardView) -> FloatArray:
        """Centre, size as a share of the picture, and how much one side looks longer than the other."""
        grid = view.pixels.reshape(self._board.rows, self._board.columns, 2)
        corners = np.array([grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]])
        top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        x, y = corners[:, 0], corners[:, 1]
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        centre = corners.mean(axis=0) / self._size
        size = math.sqrt(area / float(self._size.prod()))
        return np.array([*centre, size, math.log(left / right), math.log(top / bottom)])
